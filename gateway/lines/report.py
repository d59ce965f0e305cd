"""What a line tells of the rare things that happen on it, each counted for its unit."""

from collections.abc import Callable
from functools import partial
from typing import Final

from gateway import events
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.frame import Frame

_NO_ANSWER: Final = "no valid answer"
_DAMAGED: Final = "this is the answer, and its check sum is wrong"
_ECHO: Final = "does the adapter echo? Then set echo = true"
_ECHO_OR_ANSWER: Final = f'{_ECHO}. Or is the device its own adapter? Then set wire = "direct"'
_NO_WIRE: Final = 'if the device is its own adapter (USB CDC, a virtual machine, a soft PLC), set wire = "direct"'


class Report:
    """Tells events with what a reader needs to find the device: its line, its name, and where the config names it."""

    def __init__(self, line: str, source: str, emit: events.Emit) -> None:
        self._line = line
        self._source = source
        self._emit = emit

    def queue_full(self, transaction: Transaction) -> None:
        """A request was answered 06."""
        device = transaction.device
        self._emit(events.QueueFull(self._line, device.unit, device.name, transaction.client))

    def given_up(self, transaction: Transaction, now: float, *, heard: bytes, is_echo: bool = False) -> None:
        """No answer has come; `heard` is what came instead, `is_echo` if it is the request."""
        if heard:
            hint = f"this is the request itself: {_echo_hint(transaction)}"
            reason = hint if is_echo else _NO_ANSWER if transaction.owed else _DAMAGED
            self._tell(partial(events.BadFrame, heard=heard[:64].hex(" ").upper(), reason=reason), transaction, now)
        else:
            self._tell(events.RequestTimeout, transaction, now)

    def late_response(self, transaction: Transaction, now: float) -> None:
        """A response came after its limit."""
        transaction.counts.late_responses += 1
        self._tell(events.LateResponse, transaction, now)

    def too_early(self, transaction: Transaction, *, proven: bool) -> None:
        """The answer came before the request can have left; it is `proven` now that the port has no wire."""
        transaction.counts.early_responses += 1
        if proven:
            device, function = transaction.device, transaction.asked.function
            self._emit(
                events.AnswerTooEarly(self._line, transaction.unit, device.name, function, self._source, _NO_WIRE)
            )

    def foreign(self, frame: Frame, asked: Transaction) -> None:
        """A well-formed frame came that is not the answer to what was asked."""
        asked.counts.foreign_frames += 1
        self._emit(events.ForeignFrame(self._line, asked.unit, asked.device.name, frame.pdu[0], _text(frame)))

    def other_client(self, transaction: Transaction, frame: Frame) -> None:
        """Somebody else has asked the same unit."""
        self._emit(events.OtherClientHeard(self._line, transaction.unit, transaction.device.name, _text(frame)))

    def echo(self, transaction: Transaction, *, first: bool) -> None:
        """What was sent has come back."""
        transaction.counts.echoes += 1
        if first:
            self._emit(events.EchoHeard(self._line, self._source, _echo_hint(transaction)))

    def resting(self, device: Destination, now: float) -> None:
        """A unit rests from now on, for the first time or again."""
        rest = round(device.breaker.rest_left(now), 1)
        self._emit(events.UnitResting(self._line, device.unit, device.name, rest, device.source))

    def recovered(self, device: Destination) -> None:
        """A unit that rested has been heard."""
        self._emit(events.UnitRecovered(self._line, device.unit, device.name))

    def _tell(self, event: Callable[..., events.Event], transaction: Transaction, now: float) -> None:
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
    """What to do about a copy of the request, which may be its answer."""
    asked = transaction.asked
    return _ECHO_OR_ANSWER if asked.accepts(asked.data) else _ECHO


def _text(frame: Frame) -> str:
    return f"{frame.unit:02X} {frame.pdu.hex(' ').upper()}"
