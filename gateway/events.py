"""Log events: one class for each, logged under its name in snake_case.

Events are for what is rare. What happens in every transaction is counted, in the `Counts` of each part.
"""

import re
from collections.abc import Callable, Sequence
from enum import IntEnum
from traceback import format_exception
from typing import ClassVar, Final, Self, dataclass_transform

from gateway import errors
from gateway.errors import RequestError
from gateway.request import Request


class Level(IntEnum):
    """Log levels, with the numbers of Python's logging."""

    DEBUG = 10
    INFO = 20
    WARNING = 30
    ERROR = 40


@dataclass_transform(frozen_default=True)
class Event:
    """A log event. Its fields become the fields of the log line.

    To type checkers it is a frozen dataclass. At run time `dataclass` would compile six functions for each of the fifty
    events whenever the program starts, a tenth of all that it does until it is ready.
    """

    level: ClassVar[Level] = Level.INFO
    #: The event's name in logs: `line_lost` for LineLost.
    name: ClassVar[str]
    #: The names of its fields, in the order of the values that make it.
    field_names: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        cls.field_names = tuple(cls.__annotations__)

    def __init__(self, *values: object, **named: object) -> None:
        told, names = self.__dict__, self.field_names
        told.update(zip(names, values, strict=False), **named)
        if len(told) != len(values) + len(named) or not told.keys() <= set(names):
            raise TypeError(f"{type(self).__name__} has the fields {names}, and not {values} and {named}")
        missing = [name for name in names if name not in told and not hasattr(self, name)]
        if missing:
            raise TypeError(f"{type(self).__name__} lacks {missing}")

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{self} is frozen")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and other.fields() == self.fields()

    def __hash__(self) -> int:
        return hash((type(self), *self.fields().values()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.fields().items())})"

    def fields(self) -> dict[str, object]:
        """The fields of the log line, by name."""
        return {name: getattr(self, name) for name in self.field_names}


#: Logs an event. It never raises and never blocks.
Emit = Callable[[Event], None]


def discard_event(event: Event) -> None:
    """Log nothing."""


# --- the service ---


class ConfigLoaded(Event):
    """A config file was read and is in use."""

    file: str
    lines: int
    units: int


class ConfigWarning(Event):
    """A config file can be used, but something in it may be wrong."""

    level = Level.WARNING
    problem: str
    help: str


class ConfigRejected(Event):
    """A config file is not used; the one in use, if any, stays."""

    level = Level.ERROR
    file: str
    reason: str

    @classmethod
    def of(cls, file: str, problems: Sequence[str]) -> Self:
        """The rejection of `file` for `problems`; `reason` is the first of them."""
        reason = problems[0].splitlines()[0] + (f" (and {len(problems) - 1} more)" if problems[1:] else "")
        return cls(file, reason)


class ConfigApplied(Event):
    """A config file was read again and is in use. `restart` names the tables that apply only after a restart."""

    file: str
    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[str, ...]
    restart: tuple[str, ...]


class ControlClosed(Event):
    """The control socket cannot be used, so no command can reach this gateway. All else works."""

    level = Level.WARNING
    socket: str
    reason: str


class WebUp(Event):
    """The web page, the API and metrics can be reached over HTTP."""

    address: str


class WebClosed(Event):
    """Nothing can be reached over HTTP. All else works."""

    level = Level.WARNING
    address: str
    reason: str


class WebLogin(Event):
    """Somebody has logged in at the web page."""

    client: str
    user: str


class WebLoginFailed(Event):
    """Somebody has sent a wrong password to the web page; `user` is empty if there is no such user."""

    level = Level.WARNING
    client: str
    user: str


class WebUsersRejected(Event):
    """The file with the users cannot be used as it is now; those that were in it before stay."""

    level = Level.WARNING
    reason: str


class CertificateExpires(Event):
    """A certificate or a revocation list is valid for less than a month. `used_by` names a table of the config."""

    level = Level.WARNING
    used_by: str
    key: str
    file: str
    subject: str
    days_left: float


class BrokerUp(Event):
    """Values are published there, with this version of MQTT."""

    broker: str
    version: str


class BrokerLost(Event):
    """Nothing is published: the broker cannot be reached, or refuses. The gateway tries again."""

    level = Level.WARNING
    broker: str
    reason: str


class BrokerRefused(Event):
    """The broker does not publish what it is sent; logged once for each connection."""

    level = Level.WARNING
    broker: str
    reason: str


class FleetUp(Event):
    """The gateway is connected to this NATS server, and other sites can reach it."""

    server: str


class FleetLost(Event):
    """NATS cannot be reached, or refuses: no other site can be reached. The gateway tries again; all else works."""

    level = Level.WARNING
    server: str
    reason: str


class FleetRefused(Event):
    """NATS refuses a subject to this site; logged once for each connection."""

    level = Level.WARNING
    server: str
    reason: str


class FleetBucketUnsafe(Event):
    """A bucket of NATS has settings by which a site can harm others; logged once for each connection."""

    level = Level.WARNING
    server: str
    reason: str


class CommandRefused(Event):
    """Somebody wants to write what the broker's `topic` names, but there is no such point, or it must not be written.

    `client` is `mqtt`.
    """

    level = Level.WARNING
    client: str
    topic: str
    reason: str


class Ready(Event):
    """Clients can connect and every line was tried once. `control` is the socket for the commands."""

    listeners: tuple[str, ...]
    lines_up: int
    lines_down: int
    control: str = ""


class Stopping(Event):
    """The gateway was told to stop."""

    reason: str


class Stopped(Event):
    """The gateway has stopped."""


class PartFailed(Event):
    """A defect in the gateway: an unexpected error in a part, which is started again. Please report it."""

    level = Level.ERROR
    part: str
    error: str
    traceback: str

    @classmethod
    def of(cls, part: str, error: Exception) -> Self:
        """`error` occurred in `part`."""
        return cls(part, repr(error), "".join(format_exception(error)))


class StateNotKept(Event):
    """Values that must be kept over a restart could not be written to their file."""

    level = Level.ERROR
    file: str
    reason: str


class StateKeptAgain(Event):
    """The file can be written again."""

    file: str


class StateDamaged(Event):
    """A file in the state directory is damaged or foreign. It was moved aside; what could be read of it is used."""

    level = Level.ERROR
    file: str
    damage: str


# --- clients ---


class ClientEvent(Event):
    """An event about a client. One with a certificate has its `subject`, and its `role`, empty for the null role."""

    def fields(self) -> dict[str, object]:
        """The fields of the log line; these two only with a certificate."""
        found = super().fields()
        if not found["subject"]:
            del found["subject"], found["role"]
        return found


class ListenerUp(Event):
    """Clients can connect to this address."""

    listener: str
    address: str


class ClientConnected(ClientEvent):
    """A client has connected."""

    level = Level.DEBUG
    listener: str
    client: str
    subject: str = ""
    role: str = ""


class ClientClosed(Event):
    """A client's connection has ended."""

    level = Level.DEBUG
    listener: str
    client: str
    reason: str


class ClientRejected(Event):
    """A connection was closed because of what the client did, its missing rights, or because the listener was full."""

    level = Level.WARNING
    listener: str
    client: str
    reason: str


class RequestRefused(Event):
    """A client requested something that `unit` does not have; it got exception `code`, and nothing was sent."""

    client: str
    unit: int
    function: int
    code: str
    why: str

    @classmethod
    def of(cls, request: Request, error: RequestError) -> Self:
        """The rejection of `request` with `error`."""
        return cls(request.origin.client, request.unit, request.pdu[0], f"{error.code:02X}", str(error))


class AccessDenied(ClientEvent):
    """A client used a function without the right to it; it got exception 01, and nothing was sent."""

    level = Level.WARNING
    listener: str
    client: str
    unit: int
    function: int
    subject: str = ""
    role: str = ""


class WriteAudit(ClientEvent):
    """The result of a request that may have changed something: one event for each such request.

    `address` and `count` are the coils or registers to write; None for functions without them, and for malformed
    requests. `result` is `ok` (also for 08/04, which has no response), `exception` (from the unit), `broadcast` (no
    response), `unwanted` (the client disconnected before it was sent), or why the gateway rejected it or got no
    response, as in the counts of a unit. `code` is the exception that the client got, if any.
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
    subject: str = ""
    role: str = ""

    @property
    def was_sent(self) -> bool:
        """Whether the request was sent, so that the write may have been carried out."""
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


class LineUp(Event):
    """A line's port was opened for the first time.

    `baud` is the actual rate of the port, if its driver reports it; None if it is set elsewhere.
    """

    line: str
    port: str
    baud: int | None = None


class LineLost(Event):
    """A line's port could not be opened, or was lost; the gateway tries to open it until it succeeds."""

    level = Level.WARNING
    line: str
    port: str
    reason: str


class LeaseTaken(Event):
    """This gateway holds the lease of a line: it opens the port, and sends requests after this silence."""

    line: str
    lease: str
    silent_s: float


class LeaseLost(Event):
    """This gateway does not hold the lease of a line any more: it has closed the port, and sends nothing."""

    level = Level.WARNING
    line: str
    lease: str
    reason: str


class ConnectionRenewed(Event):
    """A line uses a new connection, because no unit has answered since a request timed out.

    The device server may still hold that request; its response would be taken for the response to the next one.
    """

    line: str
    source: str


class LineReopened(Event):
    """A lost port is open again; `baud` as in LineUp."""

    line: str
    port: str
    away_s: float
    baud: int | None = None


class RequestTimeout(Event):
    """A device did not answer within its time limit."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    elapsed_ms: float
    limit_ms: float
    source: str


class BadFrame(Event):
    """What was received within the limit was not the response: noise, a cut or foreign frame, a wrong CRC or LRC."""

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


class ForeignFrame(Event):
    """A valid frame that is not the response to the request on the line; it was dropped."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    frame: str


class QueueFull(Event):
    """The queue of a line is full. `client` had most requests in it, and its newest was answered 06."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    client: str


class AddressMoved(Event):
    """A device has a new address; `advice` names the line of the config to edit."""

    level = Level.WARNING
    line: str
    device: str
    unit: int
    was: int
    advice: str


class BaudChanged(Event):
    """A device has a new baud rate; `advice` says what the line did, and what to edit."""

    level = Level.WARNING
    line: str
    device: str
    baud: float
    advice: str


class AddressRemembered(Event):
    """A device moved in an earlier run: the gateway uses address `unit` instead of `configured`."""

    level = Level.WARNING
    line: str
    device: str
    unit: int
    configured: int
    advice: str


class BaudRemembered(Event):
    """A line followed its device to `baud` in an earlier run, and uses that rate instead of `configured`."""

    level = Level.WARNING
    line: str
    baud: int
    configured: int
    advice: str


class LateResponse(Event):
    """A response came after its time limit and was dropped. The device needs a longer one."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    elapsed_ms: float
    limit_ms: float
    source: str


class TimingTight(Event):
    """99 of 100 responses take most of their time limit: a slower one is a time-out."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    function: int
    elapsed_ms: float
    limit_ms: float
    source: str
    advice: str


class UnitResting(Event):
    """A unit backs off: it has failed three times in a row, or again after a back-off. Its requests get 0B at once.

    It is tried again after `rest_s` seconds: the late window of the last failure, and the back-off itself.
    """

    level = Level.WARNING
    line: str
    unit: int
    device: str
    rest_s: float
    source: str


class UnitRecovered(Event):
    """A unit that backed off has answered."""

    line: str
    unit: int
    device: str


class EchoHeard(Event):
    """The adapter echoes. Until `echo = true` is set, writes whose response equals the request get 0B."""

    level = Level.ERROR
    line: str
    source: str
    advice: str


class AnswerTooEarly(Event):
    """Several responses in a row came before their requests could have been sent; they were rejected."""

    level = Level.ERROR
    line: str
    unit: int
    device: str
    function: int
    source: str
    advice: str


class OtherClientHeard(Event):
    """Another client on the line sent a request to the same unit, so the next response was rejected."""

    level = Level.WARNING
    line: str
    unit: int
    device: str
    frame: str


class UpstreamClosed(Event):
    """The gateway closed its connection to an upstream, because it could not be used any more; it opens a new one."""

    level = Level.WARNING
    line: str
    reason: str


class AnswerWithheld(Event):
    """The client on a server line got no response: it would have taken it for the response to another request."""

    level = Level.WARNING
    line: str
    unit: int
    function: int
    elapsed_ms: float
    reason: str
    source: str


# --- images ---


class PollRefused(Event):
    """A device refuses a read of a mirror or of `[mqtt]`: these addresses cannot be read, or not together."""

    level = Level.WARNING
    image: str
    device: str
    addresses: str
    code: int
    source: str
