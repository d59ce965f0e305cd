"""The audit log: one event for each write, with its result."""

from collections.abc import Callable

from gateway.errors import RequestError
from gateway.events import Emit, WriteAudit
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import parse_sent
from gateway.request import Origin, Request


class AuditedOrigin(Origin):
    """The origin of a write: logs the result, then passes the response to the client's origin.

    `clock` is the clock of `received_at`; `device` is for the log, if the unit of the request is not that of clients. A
    write through a virtual unit is told with the device that it went to.
    """

    __slots__ = ("_clock", "_device", "_emit", "_is_broadcast", "_listener", "caller", "origin")

    def __init__(
        self,
        origin: Origin,
        listener: str,
        clock: Callable[[], float],
        emit: Emit,
        device: str = "",
        *,
        is_broadcast: bool,
    ) -> None:
        self.caller = origin.caller
        #: The client's own origin.
        self.origin = origin
        self._listener = listener
        self._device = device
        self._is_broadcast = is_broadcast
        self._clock = clock
        self._emit = emit

    def wants(self, request: Request) -> bool:
        """Tell whether the client still wants the response."""
        return self.origin.wants(request)

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Log the write, and pass the response on."""
        address, count = _written(request.pdu)
        caller = self.caller
        self._emit(
            WriteAudit(  # by position, in half the time: a write is one event
                caller.client,
                self._listener,
                request.unit,
                request.in_one_turn or request.pdu[0],
                address,
                count,
                self._result(request, pdu),
                f"{pdu[1]:02X}" if pdu is not None and pdu[0] & EXCEPTION_BIT else "",
                round((self._clock() - request.received_at) * 1000, 1),
                caller.subject,
                caller.role,
                self._device or request.device,
            )
        )
        self.origin.answer(request, pdu)

    def _result(self, request: Request, pdu: bytes | None) -> str:
        if request.error is not None:
            return request.error.result
        if pdu is not None:
            return "exception" if pdu[0] & EXCEPTION_BIT else "ok"
        return "broadcast" if self._is_broadcast else "ok"  # 08/04 has no response


def _written(pdu: bytes) -> tuple[int, int] | tuple[None, None]:
    """Return address and number of the coils or registers to write; None for both if the request has none."""
    try:
        span = parse_sent(pdu).write
    except RequestError:
        span = None
    return (None, None) if span is None else (span.start, span.count)
