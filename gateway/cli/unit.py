"""A unit that a command asks: through the daemon, or directly."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, Protocol

from gateway.cli.daemon import Conversation, add_control_argument
from gateway.cli.usage import WrongUsageError, parsed_by
from gateway.config.duration import parse_duration
from gateway.errors import DaemonError, ExceptionCode, GatewayError
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.profiles.point import Point

#: How much longer than the longest wait of a unit its answer may take to come here, in seconds.
_SPARE_TIME: Final = 5.0

#: Why the gateway itself has answered with an exception, and what to do, by the result that the daemon tells.
_REASONS: Final[Mapping[str, str]] = {
    "timeout": "nothing came within its time limit",
    "bad_frame": "what came within its time limit was damaged, or for somebody else",
    "ambiguous": "another client was heard on the line, so the response may be for that one",
    "line_lost": "the port was lost while the request was on the line; the unit may have acted",
    "resting": "it has failed too often and is left alone for a while; modbus-gateway status shows until when",
    "overdue": "a late response to an earlier request may still come; try again in a moment",
    "echo_suspected": "the adapter echoes; set echo = true for the line",
    "stale": "the mirror's last poll is stale: its device does not answer",
    "no_route": "there is no such unit; modbus-gateway check shows which there are",
    "denied": "[[access]] gives the control socket no right to it",
    "queue_full": "too many requests wait for the line; try again",
    "expired": "the line was busy for longer than its max_wait; try again",
    "line_down": "its line is down; modbus-gateway status shows why",
}


class NoResponseError(GatewayError):
    """A unit that was asked directly has not answered, or not to this request."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A response PDU, and how long it took.

    `reason` says why it is an exception of the gateway's own. `sent` and `received` are the frames, as far as they are
    seen here.
    """

    pdu: bytes
    elapsed_ms: float
    reason: str = ""
    sent: bytes = b""
    received: bytes = b""

    @property
    def exception(self) -> int | None:
        """The exception code, if it is one."""
        return self.pdu[1] if self.pdu[0] & EXCEPTION_BIT else None

    @property
    def complaint(self) -> str:
        """What an exception means."""
        code = self.exception or 0
        return f"exception {code:02X}, {_name(code)}" + (f": {self.reason}" if self.reason else "")


class Unit(Protocol):
    """A unit that can be asked. `number` and `name` are what clients call it; it has no name if that is not known.

    `functions` None means all, or that it is not known; `limits` is the most items of a function.
    """

    number: int
    name: str
    points: tuple[Point, ...]
    functions: frozenset[int] | None
    limits: Mapping[int, int]

    def ask(self, pdu: bytes) -> Answer:
        """Send a request. Raises DaemonError or NoResponseError."""


def add_unit_arguments(parser: argparse.ArgumentParser) -> None:
    """Which unit, and how it is reached."""
    add = parser.add_argument
    add("--swap", choices=("none", "words", "bytes", "both"), default="none", help="order in registers (default none)")
    add("--raw", action="store_true", help="show request and response in hexadecimal too")
    add("--json", action="store_true", help="print JSON instead of a table")
    add_control_argument(parser)
    direct = parser.add_argument_group("without a daemon")
    add = direct.add_argument
    add("--port", metavar="PORT", help="ask on this serial port: /dev/ttyUSB0, or rtu+tcp://host:port")
    add("--baud", type=_baud, default=19200, metavar="N", help="its rate (default 19200)")
    add("--format", metavar="F", help="its character format (default 8E1, ASCII 7E1)")
    add("--mode", choices=("rtu", "ascii"), help="what is spoken there (default rtu)")
    add("--tcp", metavar="HOST[:PORT]", help="ask this Modbus TCP server (default port 502)")
    add("--timeout", type=parsed_by(parse_duration), default=1.0, metavar="TIME", help="time limit (default 1s)")
    add("--profile", metavar="NAME", help="the kind of device, for its points: mint, v80, weigher")


@contextmanager
def open_unit(wanted: str, args: argparse.Namespace) -> Iterator[Unit]:
    """The unit of this number or name, by the way that the arguments name.

    Raises:
        DaemonError: the daemon cannot be reached, or knows no such unit.
        DirectError: the port or the server cannot be reached.
        WrongUsageError: the arguments do not fit together.
    """
    if args.port and args.tcp:
        raise WrongUsageError("--port and --tcp are two ways to the unit", "leave one of them out")
    if args.port or args.tcp:
        from gateway.cli.direct import open_directly  # noqa: PLC0415 - pymodbus takes a quarter of a second

        with open_directly(wanted, args) as unit:
            yield unit
        return
    if args.profile:
        raise WrongUsageError("--profile is for --port and --tcp; the daemon knows what its units are", "leave it out")
    with Conversation(args.control) as daemon:
        yield DaemonUnit(daemon, wanted)


class DaemonUnit:
    """A unit of the running gateway.

    Raises:
        DaemonError: it knows no such unit.
    """

    def __init__(self, daemon: Conversation, wanted: str) -> None:
        self._daemon = daemon
        unit = daemon.ask("unit", unit=int(wanted) if wanted.isdecimal() else wanted).get("unit")
        if not isinstance(unit, dict):
            raise DaemonError("the daemon's answer has no unit in it")
        functions = unit.get("functions")
        self.number: int = unit["unit"]
        self.name: str = unit.get("name", "")
        self.functions = None if functions is None else frozenset(functions)
        self.limits: Mapping[int, int] = {int(function): most for function, most in unit.get("limits", {}).items()}
        self.points = tuple(map(_point, unit.get("points", ())))
        daemon.wait_for(unit.get("longest_wait_ms", 0.0) / 1000 + _SPARE_TIME)

    def ask(self, pdu: bytes) -> Answer:
        """Send a request as the client `control`. Raises DaemonError."""
        answer = self._daemon.ask("request", unit=self.number, pdu=pdu.hex(" "))
        response = bytes.fromhex(answer["pdu"])
        result = answer.get("result", "")
        reason = _REASONS.get(result) or answer.get("reason") or result
        head = bytes((self.number,))
        return Answer(response, answer["elapsed_ms"], reason, head + pdu, head + response)


def _point(told: Mapping[str, Any]) -> Point:
    """A point as the daemon tells it. One of another version may tell more."""
    known = {name: told[name] for name in Point.__dataclass_fields__ if name in told}
    labels = {int(number): label for number, label in known.get("labels", {}).items()}
    return Point(**{**known, "area": Area(known["area"]), "labels": labels})


def _name(code: int) -> str:
    try:
        return ExceptionCode(code).name.lower().replace("_", " ")
    except ValueError:
        return "not a standard one"


def _baud(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'"{text}" is no rate; write a number such as 9600')
    return int(text)
