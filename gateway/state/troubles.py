"""Troubles with the state folder: events tell of those with its files, and the folder itself is checked."""

import asyncio
import os
from pathlib import Path
from typing import Final

from gateway.clock.threads import in_thread
from gateway.events import Emit, Event, StateDamaged, StateKeptAgain, StateNotKept
from gateway.state.status import StateFileStatus

#: How often the folder is checked, in seconds: a system that finds errors on a disk may make it read-only.
LOOK_EVERY: Final = 60.0


class StateTroubles:
    """The present troubles, as events tell of them. All events are handed on to `emit`."""

    def __init__(self, folder: Path, emit: Emit) -> None:
        self.folder = folder
        self._emit = emit
        self._not_written: dict[str, str] = {}
        self._damaged: dict[str, str] = {}

    def emit(self, event: Event) -> None:
        """Note the trouble that an event tells of, and hand the event on. Any thread may call it."""
        match event:
            case StateNotKept():
                self._not_written[event.file] = event.reason
            case StateKeptAgain():
                self._not_written.pop(event.file, None)
            case StateDamaged():
                self._damaged[event.file] = event.damage
        self._emit(event)

    def status(self) -> tuple[StateFileStatus, ...]:
        """Return all troubles; none if all is well."""
        return (
            *(StateFileStatus(file, "not written", reason) for file, reason in sorted(self._not_written.items())),
            *(StateFileStatus(file, "damaged", reason) for file, reason in sorted(self._damaged.items())),
        )

    def look(self) -> None:
        """Emit an event if the folder cannot be written any more, or can be again. Blocks."""
        folder, reason = str(self.folder), why_not_writable(self.folder)
        if reason and folder not in self._not_written:
            self.emit(StateNotKept(folder, reason))
        elif not reason and folder in self._not_written:
            self.emit(StateKeptAgain(folder))

    async def keep_looking(self) -> None:
        """Check the folder every LOOK_EVERY seconds, until cancelled."""
        while True:
            await asyncio.sleep(LOOK_EVERY)
            await in_thread("look at state folder", self.look)


def why_not_writable(folder: Path) -> str:
    """Say why no file can be made in `folder`, which need not exist yet; empty if one can."""
    there = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not there.is_dir():
        return f"{there} is no folder"
    if os.statvfs(there).f_flag & os.ST_RDONLY:
        return "Read-only file system"
    return "" if os.access(there, os.W_OK | os.X_OK, effective_ids=True) else f"no permission to write in {there}"
