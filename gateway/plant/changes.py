"""Decides which readings are published, and whether a device is available."""

from collections.abc import Mapping
from typing import Final

from gateway.plant.messages import DeviceState, Reading
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers.datatypes import Value

#: A device becomes unavailable after this many reads in a row without an answer. One may be lost on the line.
LOST_AFTER: Final = 2


class Watch:
    """The last readings of a device, and the published ones. Times are seconds of any clock.

    A reading is valid for the interval of its point plus `patience`: the seconds that a read may take.
    """

    def __init__(self, device: PublishedDevice, patience: float) -> None:
        self.device = device
        self.is_available = False
        #: The names of points to publish.
        self.changed: set[str] = set()
        self._patience = patience
        self._points = {point.name: point for point in device.points}
        self._latest: dict[str, Reading] = {}
        self._published: dict[str, Reading] = {}
        self._failures = 0

    def answered(self, values: Mapping[str, Value | None], now: float) -> bool:
        """Take the values of an answer; tell whether the device was unavailable before."""
        for name, value in values.items():
            reading = self._latest[name] = Reading(value, now)
            if self._is_due(self._points[name], reading):
                self.changed.add(name)
        self._failures = 0
        was_there, self.is_available = self.is_available, True
        return not was_there

    def failed(self) -> bool:
        """Note a read without an answer; tell whether this makes the device unavailable."""
        self._failures += 1
        if self._failures < LOST_AFTER or not self.is_available:
            return False
        self.is_available = False
        self._latest.clear()
        self.forget()
        return True

    def expire(self, now: float) -> None:
        """Forget readings that are too old; published ones are to be published as unknown."""
        old = self._latest.keys() - self.readings(now).keys()
        for name in old:
            del self._latest[name]
        self.changed |= old & self._published.keys()

    def forget(self) -> None:
        """Forget what was published, and what was to be."""
        self._published.clear()
        self.changed.clear()

    def readings(self, now: float) -> dict[str, Reading]:
        """Return the last readings that are not too old, by names of points."""
        return {
            name: reading
            for name, reading in self._latest.items()
            if now - reading.at <= self._points[name].every + self._patience
        }

    def state(self, now: float) -> DeviceState:
        """Return the state of the device for a birth."""
        return DeviceState(self.device, self.is_available, self.readings(now) if self.is_available else {})

    def published(self, readings: Mapping[str, Reading]) -> None:
        """Note that these readings were published, and the other points in `changed` as unknown."""
        self._published.update(readings)
        for name in self.changed - readings.keys():
            self._published.pop(name, None)
        self.changed.clear()

    def _is_due(self, point: PublishedPoint, reading: Reading) -> bool:
        """Tell whether a reading differs enough from the published one, or whether that is too old."""
        last = self._published.get(point.name)
        if last is None or _differ(last.value, reading.value, point.on_change):
            return True
        # The next reading comes one interval later, and would be too late then.
        return point.at_least is not None and reading.at - last.at + point.every > point.at_least


def _differ(old: Value | None, new: Value | None, deadband: float | None) -> bool:
    """Tell whether two values differ by at least the `deadband`, or at all if it is None. NaN equals NaN here."""
    if deadband is None or old is None or new is None or isinstance(old, str) or isinstance(new, str):
        return old != new and (old == old or new == new)  # noqa: PLR0124 - NaN differs from itself
    distance = abs(new - old)
    return distance >= deadband and old != new if distance == distance else (old == old) != (new == new)  # noqa: PLR0124
