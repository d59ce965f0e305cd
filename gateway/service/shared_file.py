"""A file of JSON in the state folder that several gateways may share: each changes its own entries only."""

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from threading import Lock, Thread
from typing import Any, Final, TextIO

from gateway.errors import StateError
from gateway.events import Emit, StateDamaged, StateNotKept
from gateway.ports.ownership import give_to_owner_of_folder

#: How long another gateway may take to write, in seconds.
LOCK_DEADLINE: Final = 2.0
#: How long the end of this one waits for a change to be written, in seconds. It counts from the change: files that were
#: changed together are waited for together.
CLOSING_DEADLINE: Final = 1.0
_LOCK_STEP: Final = 0.02

Entries = dict[str, Any]


class SharedFile:
    """Entries by key; `is_entry` says whether one is well-formed.

    Changes are written by a thread, those that come meanwhile together. A failure is told, and serving goes on.
    """

    def __init__(self, file: Path, is_entry: Callable[[object], bool], emit: Emit) -> None:
        self.file = file
        self._is_entry = is_entry
        self._emit = emit
        self._guard = Lock()
        self._changes: Entries = {}
        self._changed_at = 0.0
        self._writer: Thread | None = None

    def read(self) -> Entries:
        """All entries; none if there is no file.

        Raises:
            StateError: the file is there and cannot be read.
        """
        return read_entries(self.file, self._is_entry)

    def read_or_move_aside(self) -> Entries:
        """All entries; none if they cannot be read: then the file is moved aside, and that is told."""
        try:
            return self.read()
        except StateError as error:
            with suppress(OSError):
                self.file.replace(self.file.with_suffix(".damaged"))
            self._emit(StateDamaged(str(self.file), str(error.__cause__ or "it is not a file of this gateway")))
            return {}

    def change(self, key: str, entry: object | None) -> None:
        """Write an entry soon; None takes it out."""
        with self._guard:
            self._changes[key] = entry
            self._changed_at = time.monotonic()
            if self._writer is None:
                self._writer = Thread(target=self._write, name=f"write {self.file.name}", daemon=True)
                self._writer.start()

    def close(self) -> None:
        """Wait until all changes are written, but not for a disk that hangs."""
        writer = self._writer
        if writer is not None:
            writer.join(max(0.0, self._changed_at + CLOSING_DEADLINE - time.monotonic()))
            if writer.is_alive():
                self._failed("the disk, or another gateway, takes too long")

    def _write(self) -> None:
        while changes := self._next():
            try:
                with _locked(self.file):
                    _replace(self.file, self.read(), changes)
            except (OSError, StateError) as error:
                self._failed(getattr(error, "strerror", None) or str(error))

    def _next(self) -> Entries:
        with self._guard:
            changes, self._changes = self._changes, {}
            if not changes:
                self._writer = None
            return changes

    def _failed(self, reason: str) -> None:
        self._emit(StateNotKept(str(self.file), reason))


def read_entries(file: Path, is_entry: Callable[[object], bool]) -> Entries:
    """The entries of a file; none if there is no such file.

    Raises:
        StateError: it is there and cannot be read.
    """
    try:
        entries = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise StateError(f"{file} cannot be read ({error}); move it away to start without it") from error
    if not isinstance(entries, dict) or not all(map(is_entry, entries.values())):
        raise StateError(f"{file} is not a file of this gateway; move it away to start without it")
    return entries


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """In its context no other gateway changes the file.

    Raises:
        OSError: another program keeps it to itself.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + LOCK_DEADLINE
    with file.with_suffix(".lock").open("w") as lock:
        give_to_owner_of_folder(Path(lock.name))
        while not _has_locked(lock):
            if time.monotonic() > deadline:
                raise TimeoutError(None, f"another program holds {lock.name}")
            time.sleep(_LOCK_STEP)
        yield


def _has_locked(lock: TextIO) -> bool:
    try:
        flock(lock, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _replace(file: Path, entries: Entries, changes: Entries) -> None:
    changed = {key: entry for key, entry in (entries | changes).items() if entry is not None}
    fresh = file.with_suffix(".new")
    with fresh.open("w", encoding="utf-8") as stream:
        stream.write(json.dumps(changed, indent=2) + "\n")
        stream.flush()
        os.fsync(stream.fileno())
    give_to_owner_of_folder(fresh)
    fresh.replace(file)
