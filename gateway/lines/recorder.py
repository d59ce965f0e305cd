"""What a line, or an upstream, leaves in the ring: each transaction, each refusal, and what else was heard."""

from gateway.errors import RequestError, UnitResting
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.scan import Token
from gateway.request import Request
from gateway.trace.records import BYTES, INCIDENT, MOST_HEARD, SHARER, Exchange, Heard, Incident
from gateway.trace.ring import Ring


class Recorder:
    """Keeps in `ring` what happens on the line of this name."""

    __slots__ = ("_line", "_ring")

    def __init__(self, line: str, ring: Ring) -> None:
        self._line = line
        self._ring = ring

    def exchange(self, over: Transaction, response: bytes | None, now: float, answered_by: int | None = None) -> None:
        """A transaction that was sent is over: answered, or never to be.

        `answered_by` is the unit identifier of the response. Devices that move have two.
        """
        if not self._ring.is_on:
            return
        requests = over.requests
        is_exception = response is not None and response[0] >= EXCEPTION_BIT
        is_from_elsewhere = answered_by is not None and answered_by != over.unit
        if is_exception or is_from_elsewhere or over.retries or len(requests) > 1:
            record = self._incident(over, response, now)
            record.answered_by = answered_by
            if is_exception:
                self._ring.add_failure(record)
            else:
                self._ring.add(record)
            return
        first = requests[0]
        self._ring.add(
            Exchange(
                now,
                self._line,
                over.device.name,
                over.client,
                first.unit,
                over.unit,
                over.asked.data,
                response,
                first.received_at,
                over.sent_at,
                over.ends_at,
                over.limit,
            )
        )

    def failed(
        self, over: Transaction, error: RequestError | None, now: float, heard: bytes = b"", late_until: float = 0.0
    ) -> None:
        """A transaction that was sent has failed; without an error it is sent again. Its answer may come late."""
        if not self._ring.is_on:
            return
        record = self._incident(over, None, now)
        record.error = error
        record.heard = heard[:MOST_HEARD]
        record.size += BYTES + len(record.heard)
        record.late_until = late_until
        if error is None:
            self._ring.add(record)
        else:
            self._ring.add_failure(record)

    def refused(
        self, refused: Transaction, error: RequestError, now: float, *, waiting: int, late_until: float = 0.0
    ) -> None:
        """A transaction was not sent: a late window forbids it until then, or this many others wait."""
        until, count = late_until, waiting
        if isinstance(error, UnitResting):
            breaker = refused.device.breaker
            until, count = now + breaker.rest_left(now), breaker.failures
        for request in refused.requests:
            self._ring.refuse(request, error, now, line=self._line, name=refused.device.name, until=until, count=count)

    def expired(self, request: Request, name: str, error: RequestError, now: float) -> None:
        """A request for the device called `name` has waited for too long and was not sent."""
        self._ring.refuse(request, error, now, line=self._line, name=name)

    def heard(self, token: Token, owner: str) -> None:
        """A frame was heard that is not the answer; whose it is."""
        if self._ring.is_on:
            frame = token.frame
            kind = "a damaged frame" if token.is_damaged else owner
            self._ring.add(Heard(token.at, self._line, kind, bytes((frame.unit,)) + frame.pdu, 1))

    def noise(self, data: bytes, count: int, now: float) -> None:
        """This many bytes came that are not part of any frame; these are the first of them."""
        if self._ring.is_on:
            self._ring.add(Heard(now, self._line, "noise", data[:MOST_HEARD], count))

    def _incident(self, over: Transaction, response: bytes | None, now: float) -> Incident:
        first, *others = over.requests
        record = Incident(
            now,
            self._line,
            over.device.name,
            over.client,
            first.unit,
            over.unit,
            over.asked.data,
            response,
            first.received_at,
            over.sent_at,
            over.ends_at,
            over.limit,
        )
        record.retries = over.retries
        record.others = tuple([(each.caller.client, each.unit, each.received_at) for each in others])
        record.size += INCIDENT + SHARER * len(others)
        return record
