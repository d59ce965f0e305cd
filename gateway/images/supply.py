"""What supplies readers with the values of a device: polls of it, or what is heard of it."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import ClassVar

from gateway.images.polled_range import Part, Reader
from gateway.modbus.pdu import Span


class Supply(ABC):
    """Hands values of a device to the parts that readers want. `writes` is the number of finished writes to it."""

    #: What is said of a device whose values have become too old.
    silence: ClassVar[str]

    def __init__(self) -> None:
        self.writes = 0
        self._parts: dict[Part, None] = {}

    @property
    def readers(self) -> tuple[Reader, ...]:
        """Those who want something of the device."""
        return tuple(dict.fromkeys(part.reader for part in self._parts))

    @abstractmethod
    def change(self, come: Iterable[Part], gone: Iterable[Part], now: float) -> None:
        """Supply the parts that `come`, and no more those that are `gone`; all others keep their values."""

    def changed(self, span: Span | None, now: float) -> None:  # noqa: ARG002 - see DevicePolls
        """Note that a write to `span` has finished (None: every address): the values there are unknown now."""
        self.writes += 1
        for part in self._parts:
            if span is None or part.is_changed_by(span):
                part.changed(self.writes)
