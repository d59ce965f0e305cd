"""Lines, the devices on them, and other servers."""

from gateway.events.event import Event, Level


class LineUp(Event):
    """A line's port was opened for the first time.

    `baud` is the actual rate of the port, if its driver reports it; None if it is set elsewhere.
    """

    says = "line {line} is up: {port} is open[ at {baud} baud]"
    ends = ("line {line}",)
    line: str
    port: str
    baud: int | None = None


class LineLost(Event):
    """A line's port could not be opened, or was lost; the gateway tries to open it until it succeeds."""

    level = Level.WARNING
    says = "line {line} is down: {reason}"
    begins = "line {line}"
    line: str
    port: str
    reason: str


class ConnectionRenewed(Event):
    """A line uses a new connection, because no unit has answered since a request timed out.

    The device server may still hold that request; its response would be taken for the response to the next one.
    """

    says = "line {line} uses a new connection, because no unit has answered since a request timed out"
    line: str
    source: str


class LineReopened(Event):
    """A lost port is open again; `baud` as in LineUp."""

    says = "line {line} is up again after {away_s} s: {port} is open[ at {baud} baud]"
    ends = ("line {line}",)
    line: str
    port: str
    away_s: float
    baud: int | None = None


class RequestTimeout(Event):
    """A device did not answer within its time limit."""

    level = Level.WARNING
    says = "{device} did not answer function {function} within {limit_ms} ms"
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
    says = "what came from {device} was not the response to function {function}[: {reason}]"
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
    says = "a frame came on line {line} that does not answer the request to {device}"
    line: str
    unit: int
    device: str
    function: int
    frame: str


class QueueFull(Event):
    """The queue of a line is full. `client` had most requests in it, and its newest was answered 06.

    `times` is the number of further ones to the same device within five seconds, which have one event; else None.
    """

    level = Level.WARNING
    says = "the queue of line {line} is full: {client} has most requests in it, and got 06[, and {times} times more]"
    line: str
    unit: int
    device: str
    client: str
    times: int | None = None


class AddressMoved(Event):
    """A device has a new address; `advice` names the line of the config to edit."""

    level = Level.WARNING
    says = "{device} has moved from address {was} to {unit}: {advice}"
    line: str
    device: str
    unit: int
    was: int
    advice: str


class BaudChanged(Event):
    """A device has a new baud rate; `advice` says what the line did, and what to edit."""

    level = Level.WARNING
    says = "{device} has changed its rate to {baud} baud: {advice}"
    line: str
    device: str
    baud: float
    advice: str


class AddressRemembered(Event):
    """A device has moved: the gateway uses address `unit` instead of `configured`.

    Logged at each start, and when it does not answer there.
    """

    level = Level.WARNING
    says = "{device} is asked at address {unit}, not at {configured}, because it has moved: {advice}"
    line: str
    device: str
    unit: int
    configured: int
    advice: str


class BaudRemembered(Event):
    """A line followed its device to `baud` in an earlier run, and uses that rate instead of `configured`."""

    level = Level.WARNING
    says = "line {line} uses {baud} baud, not {configured}, because its device has changed: {advice}"
    line: str
    baud: int
    configured: int
    advice: str


class LateResponse(Event):
    """A response was dropped: its request had failed. After its time limit, the device needs a longer one."""

    level = Level.WARNING
    says = "a response of {device} came late, after {elapsed_ms} ms (limit {limit_ms} ms), and was dropped"
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
    says = "{device} needs nearly all of its limit: {elapsed_ms} of {limit_ms} ms: {advice}"
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
    says = "{device} rests for {rest_s} s, because it has failed several times in a row"
    begins = "unit {device}"
    line: str
    unit: int
    device: str
    rest_s: float
    source: str


class UnitRecovered(Event):
    """A unit that backed off has answered."""

    says = "{device} answers again"
    ends = ("unit {device}",)
    line: str
    unit: int
    device: str


class EchoHeard(Event):
    """The adapter echoes. Until `echo = true` is set, writes whose response equals the request get 0B."""

    level = Level.ERROR
    says = "the adapter of line {line} echoes: {advice}"
    line: str
    source: str
    advice: str


class AnswerTooEarly(Event):
    """Several responses in a row came before their requests could have been sent; they were rejected."""

    level = Level.ERROR
    says = "responses of {device} came before their requests could have been sent: {advice}"
    line: str
    unit: int
    device: str
    function: int
    source: str
    advice: str


class OtherClientHeard(Event):
    """Another client on the line sent a request to the same unit, so the next response was rejected."""

    level = Level.WARNING
    says = "another client on line {line} has asked {device}, so its next response was rejected"
    line: str
    unit: int
    device: str
    frame: str


class UpstreamClosed(Event):
    """The gateway closed its connection to an upstream, because it could not be used any more; it opens a new one."""

    level = Level.WARNING
    says = "the connection of {line} was closed, and is opened again: {reason}"
    line: str
    reason: str


class PollRefused(Event):
    """A device refuses a read of a mirror, virtual unit or `[mqtt]`: of these addresses, or of all of them together."""

    level = Level.WARNING
    says = "{device} refuses what {image} reads, {addresses}, with exception {code}"
    image: str
    device: str
    addresses: str
    code: int
    source: str
