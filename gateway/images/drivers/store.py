"""Saves images to disk: changes are collected, and a thread writes them together.

While a batch is being written, the next one is collected, so a hundred writes cost little more than ten. If a batch
cannot be written, all changes collected meanwhile fail with it: no change is saved without the earlier ones. Only
changes that were acknowledged before they were saved are tried again.

The store has the present value of every item, including changes that are not saved yet. Failed changes are undone.
"""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Final

from gateway.clock.threads import ThreadPerCall
from gateway.events import Emit, StateDamaged, StateNotKept
from gateway.images.drivers.saved import LOG, SavedValues, Values, add, open_saved
from gateway.images.persistent import Change, Done
from gateway.modbus.codes import Area
from gateway.state.file_trouble import FileTrouble

#: Seconds between writes of `keep_soon` changes: the most that a crash loses.
INTERVAL: Final = 1.0
#: How long the disk may take for the last batch, in seconds.
CLOSING_DEADLINE: Final = 2.0


@dataclass(slots=True)
class _Batch:
    """Values that are written together. `soon` values are already acknowledged."""

    values: Values = field(default_factory=dict)
    soon: Values = field(default_factory=dict)
    told: list[Done] = field(default_factory=list)
    is_due: bool = False


class Store:
    """All persistent images of a gateway, in files in `folder`."""

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._folder = folder
        self._file = str(folder / LOG)
        self._emit = emit
        self._saved: SavedValues | None = None
        self._kept: Values = {}
        #: The batch being written, and the next one.
        self._batch: _Batch | None = None
        self._next = _Batch()
        self._timer: asyncio.TimerHandle | None = None
        self._refuses = False
        self._trouble = FileTrouble(self._file, emit)
        self._is_closing = False

    @property
    def is_open(self) -> bool:
        """Whether the saved values are known."""
        return self._saved is not None

    def open(self) -> None:
        """Read the files, unless that is done, and rewrite them. Blocks. Nothing can be saved before.

        A failure to read or write them is logged.

        Raises:
            StateError: another gateway uses them, or a later version has written them.
        """
        if self._saved is not None:
            return
        try:
            saved, self._kept, damage = open_saved(self._folder)
        except OSError as error:
            self._trouble.failed(error)
            return
        if damage:
            count = sum(map(len, self._kept.values()))
            self._emit(StateDamaged(self._file, f"{damage}; {count} values could be read"))
        try:
            saved.write({}, self._kept)
        except OSError as error:
            self._trouble.failed(error)
        else:
            self._trouble.tell("")
        self._saved = saved

    def values(self, image: str) -> Mapping[Area, Mapping[int, int]]:
        """Return the present values of `image` by area and address, saved or not."""
        layers = (self._kept, *self._unsaved())
        return {
            area: dict(chain.from_iterable(each.get((image, area), {}).items() for each in layers)) for area in Area
        }

    def keep_at_once(self, change: Change, done: Done) -> None:
        """Write the change as soon as possible, then call `done`."""
        self._next.told.append(done)
        if not self._refuses:  # else it may depend on a failed change, and fails with it
            add(self._next.values, _values(change))
            self._write_when_possible()

    def keep_soon(self, change: Change, done: Done) -> None:
        """Write the change within INTERVAL; call `done` at once. After a failure it is tried again.

        While the disk fails, changes are acknowledged only after they are saved.
        """
        if self._trouble.reason:
            self.keep_at_once(change, done)
            return
        add(self._next.values, _values(change))
        add(self._next.soon, _values(change))
        self._write_later()
        done(True)

    def when_kept(self, done: Done) -> None:
        """Call `done` later, with True if everything being written now could be saved, else False."""
        if self._batch is None:
            done(True)
        else:
            self._next.told.append(done)

    def begin_closing(self) -> None:
        """Begin no more writes: `close` does the rest, perhaps in another thread than that of the event loop."""
        self._is_closing = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def close(self) -> None:
        """Write all unsaved values. Later changes are not saved."""
        saved, self._saved = self._saved, None
        if saved is None:
            return
        closing = ThreadPerCall("close images").submit(_close, saved, add({}, *self._unsaved()), self._kept)
        try:
            closing.result(CLOSING_DEADLINE)
        except Exception as error:  # noqa: BLE001 - a disk that hangs or fails must not keep the service from stopping
            reason = getattr(error, "strerror", None) or str(error) or "the disk takes too long"
            self._emit(StateNotKept(self._file, reason))

    def _unsaved(self) -> tuple[Values, Values]:
        """Return the values being written, and those collected since."""
        return self._batch.values if self._batch else {}, self._next.values

    def _write_later(self) -> None:
        if self._timer is None and not self._is_closing:
            self._timer = asyncio.get_running_loop().call_later(INTERVAL, self._write_soon)

    def _write_soon(self) -> None:
        self._timer = None
        if self._next.soon:
            self._write_when_possible()

    def _write_when_possible(self) -> None:
        self._next.is_due = True
        self._write()

    def _write(self) -> None:
        """Write the collected changes that are due, unless a batch is already being written."""
        if self._saved is None or self._is_closing or self._batch is not None or not self._next.is_due:
            return
        self._batch, self._next = self._next, _Batch()
        writing = asyncio.get_running_loop().run_in_executor(
            ThreadPerCall("keep images"), self._saved.write, self._batch.values, self._kept
        )
        writing.add_done_callback(partial(self._written, self._batch))

    def _written(self, batch: _Batch, writing: asyncio.Future[None]) -> None:
        self._batch = None
        error = writing.exception()
        if error is not None:
            self._trouble.failed(error)
            self._refuse(batch)
            return
        self._trouble.tell("")
        add(self._kept, batch.values)
        self._write()
        for done in batch.told:
            done(True)

    def _refuse(self, batch: _Batch) -> None:
        soon = add({}, batch.soon, self._next.soon)
        told = [*batch.told, *self._next.told]
        self._next = _Batch(add({}, soon), soon, told)
        if soon:
            self._write_later()
        self._refuses = True
        try:
            for done in told:  # it may grow meanwhile
                done(False)
        finally:
            told.clear()
            self._refuses = False


def _values(change: Change) -> Values:
    return {(change.image, change.area): dict(enumerate(change.values, change.start))}


def _close(saved: SavedValues, rest: Values, kept: Values) -> None:
    try:
        if rest:
            saved.write(rest, kept)
    finally:
        saved.close()
