"""What a line offers to the router: each of its devices, and all of them at once as a broadcast."""

from dataclasses import dataclass
from typing import Literal, Protocol

from gateway.errors import RequestError
from gateway.lines.transaction import Transaction
from gateway.modbus.chartime import LineTiming
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.modbus.pdu import parse_request
from gateway.profiles.profile import Profile
from gateway.request import Request
from gateway.timing.budget import AnswerTime, Budget
from gateway.timing.table import TimingTable


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """One device of a line: `unit` on the wire, `known_as` to clients. `source` is where the config names it."""

    name: str
    unit: int
    known_as: int
    profile: Profile
    answer_time: AnswerTime
    priority: Literal["normal", "high"] = "normal"
    source: str = ""


class TakesTransactions(Protocol):
    """A line, as its devices see it."""

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction."""


class Device:
    """A unit on a line: a Target. Requests that its profile refuses never reach the line."""

    def __init__(self, settings: DeviceSettings, line: TakesTransactions, timing: LineTiming) -> None:
        self.settings = settings
        self.budget = Budget(timing, settings.answer_time)
        self._line = line

    def submit(self, request: Request, now: float) -> None:
        """Send the request when the line is free, or refuse it with the exception that says why."""
        settings = self.settings
        try:
            asked = settings.profile.check(request.pdu)
        except RequestError as error:
            request.fail(error)
            return
        transaction = Transaction(
            request, asked, settings.unit, self.budget, device=settings.name, source=settings.source
        )
        self._line.submit(transaction, now)

    def __repr__(self) -> str:
        return f"<Device {self.settings.name} unit={self.settings.unit} as={self.settings.known_as}>"


class EveryDevice:
    """Unit 0 of one line: a Target that sends a broadcast and is done once it has left."""

    def __init__(self, line: TakesTransactions, timing: LineTiming) -> None:
        self._line = line
        self._budget = Budget(timing, AnswerTime(TimingTable(), margin=0.0, timeout=0.0))

    def submit(self, request: Request, now: float) -> None:
        """Send the request to unit 0. It must be one of the functions that may be broadcast, and well formed."""
        asked = parse_request(request.pdu)
        transaction = Transaction(request, asked, BROADCAST_UNIT, self._budget, device="every device", source="")
        self._line.submit(transaction, now)
