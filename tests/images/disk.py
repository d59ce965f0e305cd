"""Stands for the disk behind persistent images: what keeps their changes, and the database below that."""

import sqlite3

from gateway.images.database import Item, Opened
from gateway.images.persistent import Change
from gateway.modbus.codes import Area


class Disk:
    """Keeps changes when the test says so. One that fails takes all that came behind it with it."""

    def __init__(self, **kept) -> None:
        self.changes = []
        self._kept = {Area(name): values for name, values in kept.items()}

    def values(self, image):
        assert image == "shift-data"
        present = {area: dict(self._kept.get(area, {})) for area in Area}
        for change, _ in self.changes:
            present[change.area].update(enumerate(change.values, change.start))
        return present

    def keep_at_once(self, change, done) -> None:
        self.changes.append((change, done))

    def keep_soon(self, change, done) -> None:
        self._kept[change.area] = self.values(change.image)[change.area] | dict(enumerate(change.values, change.start))
        done(True)

    def when_kept(self, done) -> None:
        if self.changes:
            self.changes.append((Change("shift-data", Area.COILS, 0, ()), done))
        else:
            done(True)

    def keep(self, count: int = 1) -> None:
        for _ in range(count):
            change, done = self.changes.pop(0)
            self._kept[change.area] = self._kept.get(change.area, {}) | dict(enumerate(change.values, change.start))
            done(True)

    def fail(self) -> None:
        failed, self.changes = self.changes, []
        for _, done in failed:
            done(False)


class MemoryDatabase:
    """Keeps `items` as long as the test lets it. It stands in for the file of a `Store`."""

    def __init__(self) -> None:
        self.items: dict[tuple[str, Area, int], Item] = {}
        self.batches: list[list[Item]] = []
        self.is_full = False

    def open(self, folder) -> Opened:
        return Opened(self, tuple(self.items.values()))

    def write(self, items) -> None:
        self.batches.append(list(items))
        if self.is_full:
            raise sqlite3.OperationalError("database or disk is full")
        self.items |= {item[:3]: item for item in items}

    def close(self) -> None:
        pass
