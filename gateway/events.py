"""Everything worth telling an operator: one frozen dataclass an event, its name in the log is its own in snake_case.

Events are for the rare. What happens in every transaction is counted in the parts' own `Counts`.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from traceback import format_exception
from typing import ClassVar, Final, Self

from gateway import errors
from gateway.errors import RequestError
from gateway.request import Request


class Level(IntEnum):
    """How urgent an event is; the numbers are those of Python's logging."""

    DEBUG = 10
    INFO = 20
    WARNING = 30
    ERROR = 40


@dataclass(frozen=True)
class Event:
    """Something worth telling. Its fields become the fields of the log line."""

    level: ClassVar[Level] = Level.INFO
    #: The event's name in logs: `line_lost` for LineLost.
    name: ClassVar[str]

    def __init_subclass__(cls) -> None:
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    def fields(self) -> dict[str, object]:
        """What the event tells, by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


#: Where parts tell their events. It never raises and never blocks.
Emit = Callable[[Event], None]


def tell_nobody(event: Event) -> None:
    """Where nobody wants to know."""


# --- the service ---


@dataclass(frozen=True)
class ConfigLoaded(Event):
    """A config file has been read and is in force."""

    file: str
    lines: int
    units: int


@dataclass(frozen=True)
class ConfigWarning(Event):
    """A config file is usable, but something in it deserves a look."""

    level = Level.WARNING
    problem: str
    help: str


@dataclass(frozen=True)
class ConfigRejected(Event):
    """A config file is not used; the one in force, if any, stays."""

    level = Level.ERROR
    file: str
    reason: str

    @classmethod
    def of(cls, file: str, problems: Sequence[str]) -> Self:
        """The rejection of `file` for these problems. The first one is the reason."""
        reason = problems[0].splitlines()[0] + (f" (and {len(problems) - 1} more)" if problems[1:] else "")
        return cls(file, reason)


@dataclass(frozen=True)
class ConfigApplied(Event):
    """A config file has been read again and is in force. `restart` names what of it needs a restart to count."""

    file: str
    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[str, ...]
    restart: tuple[str, ...]


@dataclass(frozen=True)
class ControlClosed(Event):
    """The control socket cannot be used: `status` and `reload` cannot reach this gateway. Everything else works."""

    level = Level.WARNING
    socket: str
    reason: str


@dataclass(frozen=True)
class Ready(Event):
    """Clients can connect and every line was tried once."""

    listeners: tuple[str, ...]
    lines_up: int
    lines_down: int


@dataclass(frozen=True)
class Stopping(Event):
    """The service has been told to end."""

    reason: str


@dataclass(frozen=True)
class Stopped(Event):
    """The service has ended."""


@dataclass(frozen=True)
class PartFailed(Event):
    """A defect in the gateway: a part met an error that nobody foresaw. It starts anew; please report it."""

    level = Level.ERROR
    part: str
    error: str
    traceback: str

    @classmethod
    def of(cls, part: str, error: Exception) -> Self:
        """`part` has met `error`."""
        return cls(part, repr(error), "".join(format_exception(error)))


@dataclass(frozen=True)
class StateNotKept(Event):
    """Something that must not be forgotten over a restart could not be written to its file."""

    level = Level.ERROR
    file: str
    reason: str


@dataclass(frozen=True)
class StateKeptAgain(Event):
    """The file can be written again."""

    file: str


@dataclass(frozen=True)
class StateDamaged(Event):
    """A file with what was kept is damaged or not ours: it was moved aside, and what could be read of it serves on."""

    level = Level.ERROR
    file: str
    damage: str


# --- clients ---


@dataclass(frozen=True)
class ListenerUp(Event):
    """Clients can connect to this address."""

    listener: str
    address: str


@dataclass(frozen=True)
class ClientConnected(Event):
    """A client has connected."""

    level = Level.DEBUG
    listener: str
    client: str


@dataclass(frozen=True)
class ClientClosed(Event):
    """A client's connection has ended."""

    level = Level.DEBUG
    listener: str
    client: str
    reason: str


@dataclass(frozen=True)
class ClientRejected(Event):
    """A client's connection was closed because of what the client did, or for want of room."""

    level = Level.WARNING
    listener: str
    client: str
    reason: str


@dataclass(frozen=True)
class RequestRefused(Event):
    """A client asked for what the `unit` it named does not have: it got exception `code`, and nothing was sent."""

    client: str
    unit: int
    function: int
    code: str
    why: str

    @classmethod
    def of(cls, request: Request, error: RequestError) -> Self:
        """The refusal of `request` with `error`."""
        return cls(request.origin.client, request.unit, request.pdu[0], f"{error.code:02X}", str(error))


@dataclass(frozen=True)
class AccessDenied(Event):
    """A client asked for something it has no right to; it got exception 01 and nothing was sent."""

    level = Level.WARNING
    listener: str
    client: str
    unit: int
    function: int


@dataclass(frozen=True)
class WriteAudit(Event):
    """What became of a client's request that may have changed something: there is one for each of them.

    `address` and `count` are the coils or registers to write; None for a function that does not tell, and for a request
    that is malformed. `result` is `ok` (08/04, which has no answer, too), `exception` (of the unit), `broadcast`
    (nobody answers), `unwanted` (its client left before it was sent), or why the gateway refused it or could not get an
    answer, as in the counts of a unit.
    `code` is that of the exception that the client got, if it got one.
    """

    client: str
    listener: str
    unit: int
    function: int
    address: int | None
    count: int | None
    result: str
    code: str
    elapsed_ms: float

    @property
    def was_sent(self) -> bool:
        """Whether the write may have been carried out: it was not refused before."""
        return self.result in _SENT


#: Results of writes that went to their units.
_SENT: Final = frozenset(
    {
        *("ok", "exception", "broadcast"),
        errors.ResponseTimeout.result,
        errors.BrokenResponse.result,
        errors.AmbiguousResponse.result,
        errors.LineLost.result,
    }
)


# --- lines ---


@dataclass(frozen=True)
class LineUp(Event):
    """A line's port has been opened for the first time.

    `baud` is the rate at which the port runs, as far as its driver tells; None where it is set elsewhere.
    """

    line: str
    port: str
    baud: int | None = None


@dataclass(frozen=True)
class LineLost(Event):
    """A line's port could not be opened, or it has gone; it is tried again until it is back."""

    level = Level.WARNING
    line: str
    port: str
    reason: str


@dataclass(frozen=True)
class ConnectionRenewed(Event):
    """A line goes on with a new connection: nobody has answered since a request timed out.

    The device server may hold that request back, and its answer would be taken for that to the next one.
    """

    line: str
    source: str


@dataclass(frozen=True)
class LineReopened(Event):
    """A lost port is open again; `baud` as in LineUp."""

    line: str
    port: str
    away_s: float
    baud: int | None = None


@dataclass(frozen=True)
class RequestTimeout(Event):
    """A device did not answer within its limit."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    elapsed_ms: float
    limit_ms: float
    source: str


@dataclass(frozen=True)
class BadFrame(Event):
    """What came within the limit was not the response: noise, a cut frame, a wrong CRC or LRC, a foreign frame."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    elapsed_ms: float
    limit_ms: float
    source: str
    heard: str
    reason: str


@dataclass(frozen=True)
class ForeignFrame(Event):
    """A well-formed frame came that was not the answer to the request on the line; it was dropped."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    frame: str


@dataclass(frozen=True)
class QueueFull(Event):
    """So many requests wait for a line that one was answered 06: the newest of `client`, who had most waiting."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    client: str


@dataclass(frozen=True)
class AddressMoved(Event):
    """A device has been given another address; `advice` names the line of the config to edit."""

    level = Level.WARNING
    line: str
    device: str
    unit: int
    was: int
    advice: str


@dataclass(frozen=True)
class BaudChanged(Event):
    """A device has been given another baud rate; `advice` says what the line did, and what to edit."""

    level = Level.WARNING
    line: str
    device: str
    baud: float
    advice: str


@dataclass(frozen=True)
class AddressRemembered(Event):
    """A device moved in an earlier run: it is asked at `unit`, and not where the config says."""

    level = Level.WARNING
    line: str
    device: str
    unit: int
    configured: int
    advice: str


@dataclass(frozen=True)
class BaudRemembered(Event):
    """A line followed its device to `baud` in an earlier run, and goes on at that rate, whatever the config says."""

    level = Level.WARNING
    line: str
    baud: int
    configured: int
    advice: str


@dataclass(frozen=True)
class LateResponse(Event):
    """A response came after its limit; it was dropped. The device needs a longer time limit."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    elapsed_ms: float
    limit_ms: float
    source: str


@dataclass(frozen=True)
class UnitResting(Event):
    """A unit has failed three times in a row, or once more since: its requests are answered 0B at once.

    `rest_s` is the time until it is tried again, from now on: the late window of the last failure and the rest itself.
    """

    level = Level.WARNING
    line: str
    unit: int
    device: str
    rest_s: float
    source: str


@dataclass(frozen=True)
class UnitRecovered(Event):
    """A unit that rested has answered."""

    line: str
    unit: int
    device: str


@dataclass(frozen=True)
class EchoHeard(Event):
    """The adapter returns what is sent. Until `echo = true` is set, writes whose answer is a copy of them get 0B."""

    level = Level.ERROR
    line: str
    source: str
    advice: str


@dataclass(frozen=True)
class AnswerTooEarly(Event):
    """Several answers in a row came before their requests can have left a wire: none of them counts."""

    level = Level.ERROR
    line: str
    unit: int
    device: str
    function: int
    source: str
    advice: str


@dataclass(frozen=True)
class OtherClientHeard(Event):
    """Another client asked the same unit on the line, so the response that followed was not believed."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    frame: str


@dataclass(frozen=True)
class UpstreamClosed(Event):
    """The gateway has closed its connection to an upstream, because it cannot be used any more; it makes a new one."""

    level = Level.WARNING
    line: str
    reason: str


@dataclass(frozen=True)
class AnswerWithheld(Event):
    """The client of a server line got no answer: by then it would have taken it for the answer to something else."""

    level = Level.WARNING
    line: str
    unit: int
    function: int
    elapsed_ms: float
    reason: str
    source: str


# --- images ---


@dataclass(frozen=True)
class PollRefused(Event):
    """A device answers a mirror's poll with an exception: these addresses cannot be read, or not in one request."""

    level = Level.WARNING
    image: str
    device: str
    addresses: str
    code: int
    source: str
