"""The gateway as a whole: its config, its state, its start and its end."""

from collections.abc import Sequence
from traceback import format_exception
from typing import Self

from gateway.events.event import Event, Level


class ConfigLoaded(Event):
    """A config file was read and is in use."""

    says = "the gateway starts with {file}; lines: {lines}, units: {units}"
    ends = ("config", "state", "unit", "web")
    file: str
    lines: int
    units: int


class ConfigWarning(Event):
    """A config file can be used, but something in it may be wrong."""

    level = Level.WARNING
    says = "{problem}[; {help}]"
    problem: str
    help: str


class ConfigRejected(Event):
    """A config file is not used; the one in use, if any, stays."""

    level = Level.ERROR
    says = "{file} was rejected: {reason}"
    begins = "config"
    file: str
    reason: str

    @classmethod
    def of(cls, file: str, problems: Sequence[str]) -> Self:
        """Make the rejection of `file` for `problems`; `reason` is the first of them."""
        reason = problems[0].splitlines()[0] + (f" (and {len(problems) - 1} more)" if problems[1:] else "")
        return cls(file, reason)


class ConfigApplied(Event):
    """A config file was read again and is in use. `restart` names the tables that apply only after a restart."""

    says = (
        "{file} was applied[; added: {added}][; removed: {removed}][; changed: {changed}][; after a restart: {restart}]"
    )
    ends = ("config",)
    file: str
    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[str, ...]
    restart: tuple[str, ...]


class ControlClosed(Event):
    """The control socket cannot be used, so no command can reach this gateway. All else works."""

    level = Level.WARNING
    says = "commands cannot reach this gateway at {socket}: {reason}"
    socket: str
    reason: str


class CertificateExpires(Event):
    """A certificate or a revocation list is valid for less than a month. `used_by` names a table of the config."""

    level = Level.WARNING
    says = "the certificate {file} ({key} of {used_by}) is valid for {days_left} more days"
    begins = "{used_by}"
    used_by: str
    key: str
    file: str
    subject: str
    days_left: float


class Ready(Event):
    """Clients can connect and every line was tried once. `page` is the web page, `control` the socket for commands."""

    says = "the gateway is ready; lines up: {lines_up}, down: {lines_down}[; the web page is at {page}]"
    listeners: tuple[str, ...]
    lines_up: int
    lines_down: int
    page: str = ""
    control: str = ""


class Stopping(Event):
    """The gateway was told to stop."""

    says = "the gateway was told to stop: {reason}"
    reason: str


class Stopped(Event):
    """The gateway has stopped."""

    says = "the gateway has stopped"


class PartFailed(Event):
    """A defect in the gateway: an unexpected error in a part, which is started again. Please report it."""

    level = Level.ERROR
    says = "a defect in {part}, which was started again: {error}; please report it"
    part: str
    error: str
    traceback: str

    @classmethod
    def of(cls, part: str, error: Exception) -> Self:
        """Make the event of an `error` in `part`."""
        return cls(part, repr(error), "".join(format_exception(error)))


class EventsDropped(Event):
    """Events are missing here, `write_audits` among them: the log, or what follows the events, is too slow for them."""

    level = Level.WARNING
    says = "{dropped} events are missing here, {write_audits} write audits among them"
    dropped: int
    write_audits: int


class CustomUnitFailed(Event):
    """An error in a unit that is made in Python, in its author's code: its client got 04.

    `others` requests have failed so since the event before; `traceback` is empty if nothing was raised.
    """

    level = Level.ERROR
    says = "{device}, a unit made in Python, has failed: {error}[; {others} other requests had failed before]"
    unit: int
    device: str
    error: str
    traceback: str
    others: int | None = None


class CustomUnitsLeft(Event):
    """Calls of units made in Python did not end in time when they were cancelled, and may go on."""

    level = Level.WARNING
    says = "{devices} did not end in time, and may go on"
    devices: tuple[str, ...]


class StateNotKept(Event):
    """Values that must be kept over a restart could not be written to their file."""

    level = Level.ERROR
    says = "{file} cannot be written: {reason}"
    begins = "state"
    file: str
    reason: str


class StateKeptAgain(Event):
    """The file can be written again."""

    says = "{file} can be written again"
    ends = ("state",)
    file: str


class StateDamaged(Event):
    """A file in the state directory is damaged or foreign. It or a copy was kept; what could be read of it is used."""

    level = Level.ERROR
    says = "{file} is damaged: {damage}"
    file: str
    damage: str
