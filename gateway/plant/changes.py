"""Decides which readings are published, and whether a device is available."""

from collections.abc import Mapping
from typing import Final

from gateway.plant.messages import DeviceState, Reading
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers.datatypes import Value

#: A device becomes unavailable after this many reads in a row without an answer. One may be lost on the line.
LOST_AFTER: Final = 2


class Watch:
    """The last readings of a device, and the published ones. `now` is the clock of the event loop, `at` Unix time.

    A reading is valid for the interval of its point plus `patience`: the seconds that a read may take.
    """

    def __init__(self, device: PublishedDevice, patience: float) -> None:
        self.device = device
        self.is_available = False
        #: The readings to publish, by names of points; None for a published one that is to be taken back.
        self.changed: dict[str, Reading | None] = {}
        self._patience = patience
        self._points = {point.name: point for point in device.points}
        self._latest: dict[str, Reading] = {}
        self._published: dict[str, Reading] = {}
        self._failures = 0

    def answered(self, values: Mapping[str, Value | None], at: float, now: float) -> dict[str, Reading]:
        """Take the values of an answer; return readings that were to be published, and whose place others take."""
        displaced = {}
        for name, value in values.items():
            reading = self._latest[name] = Reading(value, at, now)
            point, waiting = self._points[name], self.changed.get(name)
            if waiting is None:
                if self._is_due(point, reading):
                    self.changed[name] = reading
            elif _differ(waiting.value, value, point.on_change):
                displaced[name] = waiting
                self.changed[name] = reading
        self._failures = 0
        self.is_available = True
        return displaced

    def failed(self) -> dict[str, Reading]:
        """Note a read without an answer; return readings that were to be published, if it becomes unavailable."""
        self._failures += 1
        if self._failures < LOST_AFTER or not self.is_available:
            return {}
        self.is_available = False
        self._latest.clear()
        waiting = self.waiting()
        self.forget()
        return waiting

    def expire(self, now: float) -> dict[str, Reading]:
        """Forget readings that are too old, and return those that were still to be published.

        Published ones are to be taken back.
        """
        old = self._latest.keys() - self.readings(now).keys()
        waiting = {name: reading for name, reading in self.waiting().items() if name in old}
        for name in old:
            del self._latest[name]
            self.changed.pop(name, None)
            if name in self._published:
                self.changed[name] = None
        return waiting

    def forget(self) -> None:
        """Forget what was published, and what was to be."""
        self._published.clear()
        self.changed.clear()

    def readings(self, now: float) -> dict[str, Reading]:
        """Return the last readings that are not too old, by names of points."""
        return {
            name: reading
            for name, reading in self._latest.items()
            if now - reading.read_at <= self._points[name].every + self._patience
        }

    def waiting(self) -> dict[str, Reading]:
        """Return the readings that are to be published."""
        return {name: reading for name, reading in self.changed.items() if reading is not None}

    def state(self, now: float) -> DeviceState:
        """Return the state of the device for a birth."""
        return DeviceState(self.device, self.is_available, self.readings(now) if self.is_available else {})

    def published(self, readings: Mapping[str, Reading]) -> None:
        """Note that these readings were published, and the other points in `changed` as unknown."""
        self._published.update(readings)
        for name in self.changed.keys() - readings.keys():
            self._published.pop(name, None)
        self.changed.clear()

    def _is_due(self, point: PublishedPoint, reading: Reading) -> bool:
        """Tell whether a reading differs enough from the published one, or whether that is too old."""
        last = self._published.get(point.name)
        if last is None or _differ(last.value, reading.value, point.on_change):
            return True
        # The next reading comes one interval later, and would be too late then.
        return point.at_least is not None and reading.read_at - last.read_at + point.every > point.at_least


def _differ(old: Value | None, new: Value | None, deadband: float | None) -> bool:
    """Tell whether two values differ by at least the `deadband`, or at all if it is None. NaN equals NaN here."""
    if deadband is None or old is None or new is None or isinstance(old, str) or isinstance(new, str):
        return old != new and (old == old or new == new)  # noqa: PLR0124 - NaN differs from itself
    distance = abs(new - old)
    return distance >= deadband and old != new if distance == distance else (old == old) != (new == new)  # noqa: PLR0124
