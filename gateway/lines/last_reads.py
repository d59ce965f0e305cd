"""The last response of a device to each of its reads, for those who want to see its values without asking for them.

Nothing is decoded here, because each answered read passes by: what the registers mean is found out by who looks.
"""

from typing import Final

from gateway.modbus.pdu import RequestPdu, Span
from gateway.registers.items import read_request
from gateway.request import Caller

#: How many different reads of a device are kept, if they are not more than twice its points.
MOST_READS: Final = 256


class LastRead:
    """The response PDU to a read of `span` for `caller`, which was sent to `unit` on the wire at `asked_at`.

    It is `outdated` once a write that may have changed these items has been sent after it, or while it was under way.
    """

    __slots__ = ("asked_at", "caller", "outdated", "response", "span", "unit")

    def __init__(self, span: Span, response: bytes, caller: Caller, unit: int, asked_at: float) -> None:
        self.span = span
        self.response = response
        self.caller = caller
        self.unit = unit
        self.asked_at = asked_at
        self.outdated = False

    def __repr__(self) -> str:
        return f"<LastRead {self.span.area} {self.span.addresses} for {self.caller.client}>"


class LastReads:
    """The last response to each read of one device, of some MOST_READS reads, or twice as many as it has `points`."""

    __slots__ = ("_by_request", "_most", "_written_at")

    def __init__(self, points: int = 0) -> None:
        self._by_request: dict[bytes, LastRead] = {}
        self._most = MOST_READS
        self._written_at = 0.0
        self.expect(points)

    def of(self, unit: int) -> list[LastRead]:
        """List those that `unit` has answered, which is the device's: it may have been at another address."""
        return [last for last in self._by_request.values() if last.unit == unit]

    def expect(self, points: int) -> None:
        """Have room for reads of so many points."""
        self._most = max(MOST_READS, 2 * points)

    def answered(
        self, asked: RequestPdu, response: bytes, caller: Caller, unit: int, asked_at: float, now: float
    ) -> None:
        """Keep the normal response to a read; note that a write was carried out."""
        outdated = asked_at < self._written_at
        if asked.write is not None or not asked.only_reads:
            self.written(asked.write, now)
        span = asked.read
        if span is None:
            return
        request = asked.data if asked.write is None else read_request(span)
        last = self._by_request.get(request)
        if last is None:
            if len(self._by_request) >= self._most:
                self._forget_half()
            last = self._by_request[request] = LastRead(span, response, caller, unit, asked_at)
        else:
            last.response = response
            last.caller = caller
            last.unit = unit
            last.asked_at = asked_at
        last.outdated = outdated

    def written(self, span: Span | None, now: float) -> None:
        """Note that a write to `span` (None: to any address) has ended, and may have been carried out."""
        self._written_at = now
        for last in self._by_request.values():
            if span is None or last.span.touches(span):
                last.outdated = True

    def _forget_half(self) -> None:
        """Forget the older half: so room is made seldom."""
        newest = sorted(self._by_request.items(), key=lambda item: item[1].asked_at)[len(self._by_request) // 2 :]
        self._by_request = dict(newest)
