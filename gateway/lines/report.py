"""What a line counts, and what it tells of the rare things that happen on it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from gateway import events
from gateway.lines.transaction import Addressee, Transaction
from gateway.modbus.frame import Frame


@dataclass(slots=True)
class Counts:
    """What has happened on a line since it was built."""

    sent: int = 0
    responses: int = 0
    exceptions: int = 0
    timeouts: int = 0
    broken: int = 0
    late_responses: int = 0
    foreign_frames: int = 0
    noise: int = 0
    echoes: int = 0
    ambiguous: int = 0
    unasked_bytes: int = 0
    broadcasts: int = 0
    retries: int = 0
    queue_full: int = 0
    waited_too_long: int = 0
    refused_resting: int = 0
    refused_overdue: int = 0


class Report:
    """Tells events with what a reader needs to find the device: its line, its name, and where the config names it."""

    def __init__(self, line: str, source: str, counts: Counts, emit: events.Emit) -> None:
        self._line = line
        self._source = source
        self._counts = counts
        self._emit = emit

    def queue_full(self, transaction: Transaction) -> None:
        """A request was answered 06."""
        self._counts.queue_full += 1
        device = transaction.device
        self._emit(events.QueueFull(self._line, device.unit, device.name, transaction.client))

    def given_up(self, transaction: Transaction, now: float, *, heard: bytes) -> None:
        """The limit has run out; `heard` is what came instead of the response."""
        self._counts.broken += bool(heard)
        self._counts.timeouts += not heard
        if heard:
            self._tell(partial(events.BadFrame, heard=heard[:64].hex(" ").upper()), transaction, now)
        else:
            self._tell(events.RequestTimeout, transaction, now)

    def late_response(self, transaction: Transaction, now: float) -> None:
        """A response came after its limit."""
        self._counts.late_responses += 1
        self._tell(events.LateResponse, transaction, now)

    def foreign(self, frame: Frame, asked: Transaction | None) -> None:
        """A well-formed frame came that is not the answer to what was asked."""
        self._counts.foreign_frames += 1
        unit, device = (asked.unit, asked.device.name) if asked is not None else (frame.unit, "")
        self._emit(events.ForeignFrame(self._line, unit, device, frame.pdu[0], _text(frame)))

    def other_client(self, transaction: Transaction, frame: Frame) -> None:
        """Somebody else has asked the same unit."""
        self._counts.ambiguous += 1
        self._emit(events.OtherClientHeard(self._line, transaction.unit, transaction.device.name, _text(frame)))

    def echo(self, *, first: bool) -> None:
        """What was sent has come back."""
        self._counts.echoes += 1
        if first:
            self._emit(events.EchoHeard(self._line, self._source))

    def resting(self, device: Addressee) -> None:
        """A unit rests from now on."""
        self._emit(events.UnitResting(self._line, device.unit, device.name, device.breaker.rest, device.source))

    def recovered(self, device: Addressee) -> None:
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


def _text(frame: Frame) -> str:
    return f"{frame.unit:02X} {frame.pdu.hex(' ').upper()}"
