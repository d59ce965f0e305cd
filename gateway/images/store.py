"""Keeps images on the disk: changes are collected, and a thread writes them together.

While a batch is being written the next one collects, so that a hundred writes cost little more than ten. If a batch
cannot be written, everything collected since has failed with it: nothing is kept without what came before it.
"""

import asyncio
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from gateway.events import Emit, StateDamaged, StateKeptAgain, StateNotKept
from gateway.images.database import FILE_NAME, Database, Item, open_database
from gateway.images.persistent import Change, Done
from gateway.images.tables import Values
from gateway.modbus.codes import Area
from gateway.ports.threads import ThreadOfItsOwn

#: The most that is lost of what `keep_soon` keeps, in seconds.
INTERVAL: Final = 1.0
#: How long the disk may take for the last batch, in seconds.
CLOSING_DEADLINE: Final = 2.0

#: Where an item stands: image, area, address.
_Place = tuple[str, Area, int]


class Store:
    """All persistent images of a gateway, in one database in `folder`. It is opened with the first of them."""

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._folder = folder
        self._file = str(folder / FILE_NAME)
        self._emit = emit
        self._database: Database | None = None
        self._kept: dict[_Place, int] = {}
        self._collected: list[tuple[Change, Done]] = []
        self._soon: dict[_Place, int] = {}
        self._due: dict[_Place, int] = {}
        self._writes = False
        self._fails = False

    def values(self, image: str) -> Iterator[tuple[Area, Values]]:
        """What is kept of `image`. To be asked for once before anything of it is to be kept.

        Raises:
            StateError: the database cannot be used.
        """
        if self._database is None:
            self._open()
        return ((area, (address, (value,))) for (name, area, address), value in self._kept.items() if name == image)

    def keep_at_once(self, change: Change, done: Done) -> None:
        """Write the change as soon as the disk is free; `done` follows."""
        self._collected.append((change, done))
        self._write()

    def keep_soon(self, change: Change, done: Done) -> None:
        """Write the change within INTERVAL; it is done already. A disk that refuses is tried again and again."""
        if not self._soon:
            self._write_later()
        self._soon.update(_values(change))
        done(True)

    def close(self) -> None:
        """Write what is not kept yet. Nothing more is kept."""
        if self._database is None:
            return
        rest = [Item(*place, value) for place, value in (self._due | self._soon).items()]
        closing = ThreadOfItsOwn("close images").submit(_close, self._database, rest)
        try:
            closing.result(CLOSING_DEADLINE)
        except Exception as error:  # noqa: BLE001 - the end of the service must not hang on a disk, nor on its error
            self._emit(StateNotKept(self._file, str(error) or "the disk takes too long"))

    def _open(self) -> None:
        self._database, items, damage = open_database(self._folder)
        self._kept = {(item.image, item.area, item.address): item.value for item in items}
        if damage:
            self._emit(StateDamaged(self._file, damage))

    def _write_later(self) -> None:
        asyncio.get_running_loop().call_later(INTERVAL, self._soon_is_now)

    def _soon_is_now(self) -> None:
        self._due.update(self._soon)
        self._soon.clear()
        self._write()

    def _write(self) -> None:
        """Write what has been collected, unless a batch is being written already."""
        if self._database is None or self._writes or not (self._collected or self._due):
            return
        batch, self._collected = self._collected, []
        due, self._due = self._due, {}
        values = dict(due)
        for change, _ in batch:
            values.update(_values(change))
        items = [Item(*place, value) for place, value in values.items()]
        self._writes = True
        writing = asyncio.get_running_loop().run_in_executor(ThreadOfItsOwn("keep images"), self._database.write, items)
        writing.add_done_callback(partial(self._written, batch, due, values))

    def _written(
        self,
        batch: list[tuple[Change, Done]],
        due: dict[_Place, int],
        values: dict[_Place, int],
        writing: asyncio.Future[None],
    ) -> None:
        self._writes = False
        error = writing.exception()
        self._tell(error)
        if error is None:
            self._kept.update(values)
            self._write()
            _all_done(batch, is_kept=True)
            return
        failed, self._collected = [*batch, *self._collected], []
        again = due | self._due
        if again and not self._soon:
            self._write_later()
        self._soon, self._due = again | self._soon, {}
        _all_done(failed, is_kept=False)

    def _tell(self, error: BaseException | None) -> None:
        """Trouble is told when it begins and when it ends."""
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


def _all_done(changes: list[tuple[Change, Done]], *, is_kept: bool) -> None:
    for _, done in changes:
        done(is_kept)
