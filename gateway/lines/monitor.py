"""What passes on a line where others ask and answer, and the gateway only listens."""

from collections.abc import Callable
from dataclasses import dataclass

from gateway.events import Emit
from gateway.lines.settings import LineSettings
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu
from gateway.trace.ring import Ring

#: Returns the late window of a request to a unit on the wire, in seconds.
Windows = Callable[[int, RequestPdu], float]


@dataclass(frozen=True, slots=True)
class HeardTransaction:
    """A request that somebody sent to `unit`, and its response; None if none was heard within its late window.

    Its values may be taken if it `is_sure`.
    """

    unit: int
    asked: RequestPdu
    response: Frame | None
    asked_at: float
    answered_at: float
    is_sure: bool


class Monitor:
    """Finds the transactions of others in the bytes of a line, and tells `heard` of each.

    There is no I/O here: bytes and time are arguments, and `deadline` is when to call `tick`.
    """

    def __init__(
        self,
        settings: LineSettings,
        windows: Windows,
        emit: Emit,
        ring: Ring,
        heard: Callable[[HeardTransaction, float], None],
    ) -> None:
        self.settings = settings
        self._windows = windows
        self._emit = emit
        self._ring = ring
        self._tell = heard

    def port_up(self, now: float) -> None:
        """Begin to listen."""

    def port_down(self, now: float) -> None:
        """Forget what was heard: the port was lost."""

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Take bytes."""

    def deadline(self) -> float | None:
        """Return when to call `tick`; None if there is no need to."""
        return None

    def tick(self, now: float) -> None:
        """Let time pass."""
