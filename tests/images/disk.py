"""Stands for the disk behind persistent images: what keeps their changes, and the files below that."""

import errno
from copy import deepcopy

from gateway.images.drivers.saved import Opened, Values, add
from gateway.images.persistent import Change
from gateway.modbus.codes import Area


class Disk:
    """Keeps changes when the test says so. One that fails takes all that came behind it with it."""

    def __init__(self, **kept) -> None:
        self.changes = []
        self._kept = {Area(name): values for name, values in kept.items()}

    is_open = True

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


class MemoryFiles:
    """Keeps `kept` as long as the test lets it. It stands in for the files of a `Store`; `batches` are its writes."""

    def __init__(self) -> None:
        self.kept: Values = {}
        self.batches: list[Values] = []
        self.is_full = False

    def open(self, folder) -> Opened:
        return Opened(self, deepcopy(self.kept))

    def write(self, values: Values, kept: Values) -> None:
        if values:
            self.batches.append(values)
        if self.is_full:
            raise OSError(errno.ENOSPC, "No space left on device")
        add(self.kept, values)

    def close(self) -> None:
        pass
