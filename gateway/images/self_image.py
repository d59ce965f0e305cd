"""The gateway's own state as a unit: a read-only image, filled when it is read."""

from collections.abc import Callable, Mapping
from math import inf
from typing import Final

from gateway.events import Emit, discard_event
from gateway.images.image import Image, ImageSettings
from gateway.images.self_map import FRESHNESS, PROFILE, RANGES, Shown, registers
from gateway.images.services import Diagnostics
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.request import Request
from gateway.trace.ring import Ring

#: Its product name in function 43.
PRODUCT: Final = "gateway"
#: Its name for `read`, in events and for function 43.
NAME: Final = "gateway"


def self_settings(unit: int, source: str) -> ImageSettings:
    """Make the settings of the gateway's own image."""
    areas = {Area.HOLDING: RANGES, Area.INPUT: RANGES}
    return ImageSettings(unit, NAME, PROFILE, areas, shows_gateway=True, source=source)


class SelfImage(Image):
    """Shows the result of `look` at the time of a request; zeros while `look` is None."""

    def __init__(self, settings: ImageSettings, emit: Emit = discard_event, ring: Ring | None = None) -> None:
        self.look: Callable[[float], Shown] | None = None
        self._diagnostics = SelfDiagnostics()
        super().__init__(settings, emit, ring, self._diagnostics, PRODUCT)
        self._looked_at = -inf
        #: The sizes of the present values in bytes, by address.
        self._filled: dict[int, int] = {}

    def submit(self, request: Request, now: float) -> None:
        """Answer `request` with current values."""
        self.look_again(now)
        super().submit(request, now)

    def look_again(self, now: float) -> None:
        """Update the values, unless they are fresh."""
        if self.look is not None and not 0 <= now - self._looked_at < FRESHNESS:
            self._show(self.look(now))
            self._looked_at = now

    def _show(self, shown: Shown) -> None:
        before, self._filled = self._filled, {}
        for start, data in registers(shown):
            size = max(len(data), before.pop(start, 0))
            self._filled[start] = len(data)
            self._put(start, data.ljust(size, b"\0"))
        for start, size in before.items():
            self._put(start, bytes(size))
        self._diagnostics.of_lines = shown.counters

    def _put(self, start: int, data: bytes) -> None:
        for area in (Area.HOLDING, Area.INPUT):
            self.tables[area].write(Span(area, start, len(data) // 2), data)


class SelfDiagnostics(Diagnostics):
    """Counters of the lines beside those of the unit itself. Clearing them does not clear the lines' own counters."""

    def __init__(self) -> None:
        #: The counters of the lines by sub-function of 08, since the start.
        self.of_lines: Mapping[int, int] = {}
        super().__init__()

    def _clear(self) -> None:
        super()._clear()
        self._cleared_at = self.of_lines

    def counter(self, asked: int) -> int:
        """Return the counter of sub-function `asked` of 08, since it was last cleared."""
        if asked in self.of_lines:
            return (self.of_lines[asked] - self._cleared_at.get(asked, 0)) & 0xFFFF
        return super().counter(asked)
