"""The reports of a line or an upstream: log events, most of which are counted too, and records for the trace.

Transactions, refusals and other received frames are recorded in the ring for a while.
"""

from collections.abc import Callable
from functools import partial
from typing import Final

from gateway import events
from gateway.errors import RequestError, UnitResting
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.explain import Mode, explain
from gateway.modbus.frame import Frame
from gateway.modbus.scan import Token
from gateway.request import Request
from gateway.trace.records import BYTES, INCIDENT, MOST_HEARD, SHARER, Heard, Incident, Sent
from gateway.trace.ring import Ring

_NO_ANSWER: Final = "no valid answer"
_DAMAGED: Final = "this is the answer, and its check sum is wrong"
_ECHO: Final = "does the adapter echo? Then set echo = true"
_ECHO_OR_ANSWER: Final = f'{_ECHO}. Or is the device its own adapter? Then set wire = "direct"'
_NO_WIRE: Final = 'if the device is its own adapter (USB CDC, a virtual machine, a soft PLC), set wire = "direct"'


class Telling:
    """Logs events of a line, each with what a reader needs to find the device: line, name, place in the config.

    Records in `ring` what happens on the line.
    """

    def __init__(self, line: str, source: str, emit: events.Emit, mode: Mode, ring: Ring | None) -> None:
        self._line = line
        self._source = source
        self._emit = emit
        self._mode = mode
        self._ring = ring or Ring()

    # --- events ---

    def queue_full(self, device: Destination, client: str, times: int | None = None) -> None:
        """Report that a request got 06, or so many more."""
        self._emit(events.QueueFull(self._line, device.unit, device.name, client, times))

    def given_up(
        self, transaction: Transaction, now: float, *, received: bytes, is_echo: bool, is_damaged: bool = False
    ) -> None:
        """Report that `received` came, no valid response; `is_echo`: it is the request, `is_damaged`: the response."""
        is_told = bool(received) and not is_echo
        why = explain(transaction.asked, transaction.answers_from, received, self._mode) if is_told else ""
        transaction.device.counts.record_instead(received, why)
        if why:
            transaction.counts.explained += len(transaction.requests)
        if received:
            hint = f"this is the request itself: {_echo_hint(transaction)}"
            reason = hint if is_echo else why or (_DAMAGED if is_damaged else _NO_ANSWER)
            self._log(partial(events.BadFrame, heard=received[:64].hex(" ").upper(), reason=reason), transaction, now)
        else:
            self._log(events.RequestTimeout, transaction, now)

    def late_response(self, transaction: Transaction, now: float) -> None:
        """Count a response after its request had failed: at its limit, or because it was ambiguous."""
        transaction.counts.late_responses += 1
        if transaction.times.came_late(now - transaction.ends_at, transaction.limit):
            transaction.device.counts.record("late", now)
        self._log(events.LateResponse, transaction, now)

    def too_early(self, transaction: Transaction, *, proven: bool) -> None:
        """Count a response that came before the request can have been sent; `proven`: the port has no wire."""
        transaction.counts.early_responses += 1
        if proven:
            device, function = transaction.device, transaction.asked.function
            event = events.AnswerTooEarly(self._line, transaction.unit, device.name, function, self._source, _NO_WIRE)
            self._emit(event)

    def foreign(self, frame: Frame, asked: Transaction) -> None:
        """Count a valid frame that is not the response to `asked`."""
        asked.counts.foreign_frames += 1
        self._emit(events.ForeignFrame(self._line, asked.unit, asked.device.name, frame.pdu[0], _text(frame)))

    def other_client(self, transaction: Transaction, frame: Frame) -> None:
        """Report that another client has sent a request to the same unit."""
        self._emit(events.OtherClientHeard(self._line, transaction.unit, transaction.device.name, _text(frame)))

    def echo(self, transaction: Transaction, *, first: bool) -> None:
        """Count a copy of the request that came from the adapter."""
        transaction.counts.echoes += 1
        if first:
            self._emit(events.EchoHeard(self._line, self._source, _echo_hint(transaction)))

    def resting(self, device: Destination, now: float) -> None:
        """Report that a unit begins to rest."""
        rest = round(device.breaker.rest_left(now), 1)
        self._emit(events.UnitResting(self._line, device.unit, device.name, rest, device.source))

    def recovered(self, device: Destination) -> None:
        """Report that a unit that rested has responded."""
        self._emit(events.UnitRecovered(self._line, device.unit, device.name))

    # --- the ring ---

    def record_sent(
        self, over: Transaction, response: bytes | None, now: float, answered_by: int | None = None
    ) -> None:
        """Record a transaction that was sent and is over: answered, or without an answer to expect.

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
            Sent(
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

    def record_failed(
        self, over: Transaction, error: RequestError | None, now: float, heard: bytes = b"", late_until: float = 0.0
    ) -> None:
        """Record a transaction that was sent and failed. Without an error it is sent again; an answer may come late."""
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

    def record_refused(
        self, refused: Transaction, error: RequestError, now: float, *, waiting: int, late_until: float = 0.0
    ) -> None:
        """Record a transaction that was not sent: a late window forbids it until `late_until`, or others wait."""
        until, count = late_until, waiting
        if isinstance(error, UnitResting):
            breaker = refused.device.breaker
            until, count = now + breaker.rest_left(now), breaker.failures
        for request in refused.requests:
            self._ring.refuse(request, error, now, line=self._line, name=refused.device.name, until=until, count=count)

    def record_expired(self, request: Request, name: str, error: RequestError, now: float) -> None:
        """Record a request for the device named `name` that has waited too long and was not sent."""
        self._ring.refuse(request, error, now, line=self._line, name=name)

    def record_heard(self, token: Token, owner: str) -> None:
        """Record a frame that is not the response, and its owner."""
        frame = token.frame
        self.record_frame(frame.unit, frame.pdu, "a damaged frame" if token.is_damaged else owner, token.at)

    def record_frame(self, unit: int, pdu: bytes, owner: str, at: float) -> None:
        """Record a frame that came `at` this time and is not the response."""
        if self._ring.is_on:
            self._ring.add(Heard(at, self._line, owner, bytes((unit,)) + pdu, 1))

    def record_noise(self, data: bytes, count: int, now: float) -> None:
        """Record `count` bytes that belong to no frame; `data` are the first of them."""
        if self._ring.is_on:
            self._ring.add(Heard(now, self._line, "noise", data[:MOST_HEARD], count))

    def _log(self, event: Callable[..., events.Event], transaction: Transaction, now: float) -> None:
        self._emit(
            event(
                line=self._line,
                unit=transaction.unit,
                device=transaction.device.name,
                function=transaction.asked.function,
                elapsed_ms=round((now - transaction.ends_at) * 1000, 1),
                limit_ms=round(transaction.limit * 1000, 1),
                source=transaction.device.source,
            )
        )

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


def _echo_hint(transaction: Transaction) -> str:
    """Return the advice for a copy of the request, which may be its response."""
    asked = transaction.asked
    return _ECHO_OR_ANSWER if asked.accepts(asked.data) else _ECHO


def _text(frame: Frame) -> str:
    return f"{frame.unit:02X} {frame.pdu.hex(' ').upper()}"
