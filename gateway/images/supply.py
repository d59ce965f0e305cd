"""What supplies readers with the values of a device: polls of it, or what is heard of it."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

from gateway.images.places import Places
from gateway.images.polled_range import Part, Reader
from gateway.modbus.pdu import Span


class Supply(ABC):
    """Hands values of a device to the parts that readers want. `writes` is the number of finished writes to it."""

    #: What is said of a device whose values have become too old.
    silence: ClassVar[str]

    def __init__(self) -> None:
        self.writes = 0
        self._parts: dict[Part, None] = {}
        #: The parts by the addresses at which a write changes them; None since others have come or gone.
        self._places: Places[Part] | None = None

    @property
    def readers(self) -> tuple[Reader, ...]:
        """Those who want something of the device."""
        return tuple(dict.fromkeys(part.reader for part in self._parts))

    @abstractmethod
    def change(self, come: Iterable[Part], gone: Iterable[Part], now: float) -> None:
        """Supply the parts that `come`, and no more those that are `gone`; all others keep their values."""

    @abstractmethod
    def changed(self, span: Span | None, now: float) -> None:
        """Note that a write to `span` has finished (None: every address): the values there are unknown now."""

    def _supply(self, come: Iterable[Part], gone: Iterable[Part]) -> None:
        for part in gone:
            self._parts.pop(part, None)
        self._parts.update(dict.fromkeys(come))
        self._places = None

    def _forget(self, span: Span | None) -> Sequence[Part]:
        """Forget the values that a write has changed. Return their parts."""
        self.writes += 1
        if span is None:
            changed = list(self._parts)
        else:
            if self._places is None:
                self._places = Places((place, part) for part in self._parts for place in part.changed_at)
            changed = self._places.touched(span)
        for part in changed:
            part.changed(self.writes)
        return changed
