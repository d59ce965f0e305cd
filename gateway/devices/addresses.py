"""The possible addresses of a device that can change its address.

A change without a response may have happened or not. Until a response shows which, the device has several possible
addresses, and all of them are reserved. A response to a request sent before the change proves nothing.
"""

from collections.abc import Callable

from gateway.lines.transaction import Transaction

#: Called with all possible addresses whenever they change, the last confirmed one first.
Remember = Callable[..., None]


class UnitAddresses:
    """The possible unit identifiers of each device on a line."""

    def __init__(self) -> None:
        self._units: dict[str, tuple[int, ...]] = {}

    def place(self, device: str, *units: int) -> None:
        """Reserve `units`: `device` has one of them."""
        self._units[device] = units

    def is_free(self, unit: int, device: str) -> bool:
        """Tell whether no device but `device` may have `unit`."""
        return not any(unit in units for name, units in self._units.items() if name != device)


class Whereabouts:
    """The possible unit identifiers of one device, `units`: first the last confirmed one, then those of changes.

    They are empty if the device cannot be asked, because another device now has its address.
    """

    def __init__(self, device: str, line: UnitAddresses, remember: Remember) -> None:
        self.units: tuple[int, ...] = ()
        self._device = device
        self._line = line
        self._remember = remember
        self._last_change: Transaction | None = None

    @property
    def is_doubtful(self) -> bool:
        """Whether there are several possible addresses."""
        return len(self.units) > 1

    def begin_at(self, *units: int) -> None:
        """Adopt the addresses known from an earlier run, or from another gateway."""
        self.units = units
        self._line.place(self._device, *units)

    def is_free(self, unit: int) -> bool:
        """Tell whether no other device may have `unit`."""
        return self._line.is_free(unit, self._device)

    def add(self, unit: int, change: Transaction) -> None:
        """Reserve `unit` too, because a change to it is sent."""
        self._last_change = change
        self._become(*dict.fromkeys((*self.units, unit)))

    def is_shown_by(self, transaction: Transaction, unit: int) -> bool:
        """Tell whether a response from `unit` proves that the device is there."""
        change = self._last_change
        if transaction is change:
            return bool(self.units)
        return unit in self.units and (change is None or transaction.sent_at > change.sent_at)

    def settle(self, unit: int) -> int:
        """Settle on `unit`. Return the previous address."""
        was = self.units[0]
        self._become(unit)
        return was

    def after(self, unit: int) -> int:
        """Return the possible address next in turn after `unit`."""
        at = self.units.index(unit) + 1 if unit in self.units else 0
        return self.units[at % len(self.units)] if self.units else unit

    def _become(self, *units: int) -> None:
        if units != self.units:
            self.begin_at(*units)
            self._remember(*units)
