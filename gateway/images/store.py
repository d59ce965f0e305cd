"""Saves images to disk: changes are collected, and a thread writes them together.

While a batch is being written, the next one is collected, so a hundred writes cost little more than ten. If a batch
cannot be written, all changes collected meanwhile fail with it: no change is saved without those before it. Only
changes that were acknowledged before they were saved are tried again.

The store has the present value of every item, including changes that are not saved yet. Failed changes are undone.
"""

import asyncio
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Final

from gateway.events import Emit, StateDamaged, StateKeptAgain, StateNotKept
from gateway.images.database import FILE_NAME, Item, open_database
from gateway.images.persistent import Change, Done
from gateway.modbus.codes import Area
from gateway.ports.database import Database
from gateway.ports.threads import ThreadPerCall

#: How often changes of `keep_soon` are written, in seconds: the most that a crash loses.
INTERVAL: Final = 1.0
#: How long the disk may take for the last batch, in seconds.
CLOSING_DEADLINE: Final = 2.0

#: The place of an item: image, area, address.
_Place = tuple[str, Area, int]


@dataclass(slots=True)
class _Batch:
    """Values that are written together. `soon` are those that are already acknowledged."""

    values: dict[_Place, int] = field(default_factory=dict)
    soon: dict[_Place, int] = field(default_factory=dict)
    told: list[Done] = field(default_factory=list)
    is_due: bool = False


class Store:
    """All persistent images of a gateway, in one database in `folder`."""

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._folder = folder
        self._file = str(folder / FILE_NAME)
        self._emit = emit
        self._database: Database | None = None
        self._kept: defaultdict[tuple[str, Area], dict[int, int]] = defaultdict(dict)
        #: The batch being written, and the next one.
        self._batch: _Batch | None = None
        self._next = _Batch()
        self._timer: asyncio.TimerHandle | None = None
        self._refuses = False
        self._fails = False

    def open(self) -> None:
        """Open the database, if it is not open yet. Nothing can be saved before that.

        Raises:
            StateError: it cannot be used.
        """
        if self._database is not None:
            return
        self._database, items, damage = open_database(self._folder)
        self._mark_saved(((item.image, item.area, item.address), item.value) for item in items)
        if damage:
            self._emit(StateDamaged(self._file, damage))

    def values(self, image: str) -> Mapping[Area, Mapping[int, int]]:
        """The present values of `image` by area and address, saved or not."""
        present = {area: dict(self._kept[image, area]) for area in Area}
        for (name, area, address), value in self._list_unsaved():
            if name == image:
                present[area][address] = value
        return present

    def keep_at_once(self, change: Change, done: Done) -> None:
        """Write the change as soon as possible, then call `done`."""
        self._next.told.append(done)
        if not self._refuses:  # else it may depend on a failed change, and fails with it
            self._next.values.update(_values(change))
            self._write_when_possible()

    def keep_soon(self, change: Change, done: Done) -> None:
        """Write the change within INTERVAL; `done` is called at once. After a failure it is tried again."""
        self._next.values.update(_values(change))
        self._next.soon.update(_values(change))
        self._write_later()
        done(True)

    def when_kept(self, done: Done) -> None:
        """Call `done` later with whether everything being written now could be saved."""
        if self._batch is None:
            done(True)
        else:
            self._next.told.append(done)

    def close(self) -> None:
        """Write what is not saved yet. Later changes are not saved."""
        if self._database is None:
            return
        rest = [Item(*place, value) for place, value in dict(self._list_unsaved()).items()]
        closing = ThreadPerCall("close images").submit(_close, self._database, rest)
        try:
            closing.result(CLOSING_DEADLINE)
        except Exception as error:  # noqa: BLE001 - a disk that hangs or fails must not keep the service from stopping
            self._emit(StateNotKept(self._file, str(error) or "the disk takes too long"))

    def _list_unsaved(self) -> Iterator[tuple[_Place, int]]:
        """Values that are being written or collected, in their order."""
        being_written = self._batch.values if self._batch else {}
        return chain(being_written.items(), self._next.values.items())

    def _mark_saved(self, values: Iterable[tuple[_Place, int]]) -> None:
        for (image, area, address), value in values:
            self._kept[image, area][address] = value

    def _write_later(self) -> None:
        if self._timer is None:
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
        if self._database is None or self._batch is not None or not self._next.is_due:
            return
        self._batch, self._next = self._next, _Batch()
        items = [Item(*place, value) for place, value in self._batch.values.items()]
        writing = asyncio.get_running_loop().run_in_executor(ThreadPerCall("keep images"), self._database.write, items)
        writing.add_done_callback(partial(self._written, self._batch))

    def _written(self, batch: _Batch, writing: asyncio.Future[None]) -> None:
        self._batch = None
        error = writing.exception()
        self._tell(error)
        if error is not None:
            self._refuse(batch)
            return
        self._mark_saved(batch.values.items())
        self._write()
        for done in batch.told:
            done(True)

    def _refuse(self, batch: _Batch) -> None:
        soon = batch.soon | self._next.soon
        told = [*batch.told, *self._next.told]
        self._next = _Batch(dict(soon), soon, told)
        if soon:
            self._write_later()
        self._refuses = True
        try:
            for done in told:  # which grows while it is called
                done(False)
        finally:
            told.clear()
            self._refuses = False

    def _tell(self, error: BaseException | None) -> None:
        """A failure is logged when it begins and when it ends."""
        if error is not None and not self._fails:
            self._emit(StateNotKept(self._file, str(error)))
        if error is None and self._fails:
            self._emit(StateKeptAgain(self._file))
        self._fails = error is not None


def _close(database: Database, rest: list[Item]) -> None:
    try:
        database.write(rest)
    finally:
        database.close()


def _values(change: Change) -> Iterator[tuple[_Place, int]]:
    for address, value in enumerate(change.values, change.start):
        yield (change.image, change.area, address), value
