"""The log events of a line; most are counted too."""

from collections.abc import Callable
from functools import partial
from typing import Final

from gateway import events
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.explain import Mode, explain
from gateway.modbus.frame import Frame

_NO_ANSWER: Final = "no valid answer"
_DAMAGED: Final = "this is the answer, and its check sum is wrong"
_ECHO: Final = "does the adapter echo? Then set echo = true"
_ECHO_OR_ANSWER: Final = f'{_ECHO}. Or is the device its own adapter? Then set wire = "direct"'
_NO_WIRE: Final = 'if the device is its own adapter (USB CDC, a virtual machine, a soft PLC), set wire = "direct"'


class Report:
    """Logs events with what a reader needs to find the device: its line, its name, and its place in the config."""

    def __init__(self, line: str, source: str, emit: events.Emit, mode: Mode) -> None:
        self._line = line
        self._source = source
        self._emit = emit
        self._mode = mode

    def queue_full(self, transaction: Transaction) -> None:
        """A request got 06."""
        device = transaction.device
        self._emit(events.QueueFull(self._line, device.unit, device.name, transaction.client))

    def given_up(self, transaction: Transaction, now: float, *, received: bytes, is_echo: bool) -> None:
        """No valid response came; `received` came instead, `is_echo` if that is the request."""
        is_told = bool(received) and not is_echo
        why = explain(transaction.asked, transaction.answers_from, received, self._mode) if is_told else ""
        transaction.device.counts.record_instead(received, why)
        if why:
            transaction.counts.explained += len(transaction.requests)
        if received:
            hint = f"this is the request itself: {_echo_hint(transaction)}"
            is_damaged = self._mode != "tcp" and not transaction.outstanding
            reason = hint if is_echo else why or (_DAMAGED if is_damaged else _NO_ANSWER)
            self._log(partial(events.BadFrame, heard=received[:64].hex(" ").upper(), reason=reason), transaction, now)
        else:
            self._log(events.RequestTimeout, transaction, now)

    def late_response(self, transaction: Transaction, now: float) -> None:
        """A response came after its request had failed: at its limit, or when one came that may be another client's."""
        transaction.counts.late_responses += 1
        if transaction.times.came_late(now - transaction.ends_at, transaction.limit):
            transaction.device.counts.record("late", now)
        self._log(events.LateResponse, transaction, now)

    def too_early(self, transaction: Transaction, *, proven: bool) -> None:
        """The response came before the request can have been sent; `proven`: the port has no wire."""
        transaction.counts.early_responses += 1
        if proven:
            device, function = transaction.device, transaction.asked.function
            event = events.AnswerTooEarly(self._line, transaction.unit, device.name, function, self._source, _NO_WIRE)
            self._emit(event)

    def foreign(self, frame: Frame, asked: Transaction) -> None:
        """A valid frame came that is not the response to `asked`."""
        asked.counts.foreign_frames += 1
        self._emit(events.ForeignFrame(self._line, asked.unit, asked.device.name, frame.pdu[0], _text(frame)))

    def other_client(self, transaction: Transaction, frame: Frame) -> None:
        """Another client has sent a request to the same unit."""
        self._emit(events.OtherClientHeard(self._line, transaction.unit, transaction.device.name, _text(frame)))

    def echo(self, transaction: Transaction, *, first: bool) -> None:
        """A copy of the request came from the adapter."""
        transaction.counts.echoes += 1
        if first:
            self._emit(events.EchoHeard(self._line, self._source, _echo_hint(transaction)))

    def resting(self, device: Destination, now: float) -> None:
        """A unit begins to rest."""
        rest = round(device.breaker.rest_left(now), 1)
        self._emit(events.UnitResting(self._line, device.unit, device.name, rest, device.source))

    def recovered(self, device: Destination) -> None:
        """A unit that rested has responded."""
        self._emit(events.UnitRecovered(self._line, device.unit, device.name))

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


def _echo_hint(transaction: Transaction) -> str:
    """The advice for a copy of the request, which may be its response."""
    asked = transaction.asked
    return _ECHO_OR_ANSWER if asked.accepts(asked.data) else _ECHO


def _text(frame: Frame) -> str:
    return f"{frame.unit:02X} {frame.pdu.hex(' ').upper()}"
