"""A unit to read or write: through the gateway or directly."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Protocol

from gateway.cli.kit.daemon import Conversation, add_control_argument
from gateway.cli.kit.usage import add_port_arguments, parsed_by
from gateway.config.values.duration import parse_duration
from gateway.errors import GatewayError
from gateway.modbus.codes import Area
from gateway.operator.operations.asked import OneRequest, OneUnit
from gateway.operator.operations.table import REQUEST, UNIT
from gateway.operator.values.steps import Answer, Step
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.profile import Range
from gateway.profiles.read_rules import ReadRules

#: How much longer than the longest wait of a unit its response may take to arrive here, in seconds.
_SPARE_TIME: Final = 5.0

#: Why the gateway itself has answered with an exception, and what to do, by its `result`.
_REASONS: Final[Mapping[str, str]] = {
    "timeout": "no response within its time limit",
    "bad_frame": "the response was damaged, or was not for this request",
    "ambiguous": "another client is on the line, and the response may be for that one",
    "line_lost": "the port was lost while the request was on the line; the unit may have acted",
    "resting": "it backs off after several failures; modbus-gateway status shows for how long",
    "overdue": "a late response to an earlier request may still come; try again in a moment",
    "echo_suspected": "the adapter echoes; set echo = true for the line",
    "no_route": "there is no such unit; modbus-gateway check lists the units",
    "only_heard": "others ask it, and the gateway only listens there; values shows what was heard, a mirror answers",
    "denied": "[[access]] does not allow it for the control socket",
    "queue_full": "too many requests wait for the line; try again",
    "expired": "the line was busy for longer than its max_wait; try again",
    "line_down": "its line is down; modbus-gateway status shows why",
}
#: The results for which the gateway's own reason says more, if it has one.
_TOLD_BETTER: Final = ("line_down", "queue_full", "expired")


class NoResponseError(GatewayError):
    """A unit that was accessed directly has not responded, or not to this request."""


class Unit(Protocol):
    """A unit that can be read and written. `name` is empty if it is not known.

    `number` is its unit ID for clients, None if it has only a name. `gateway` is the control socket through which it is
    asked, None without a gateway. `is_virtual` tells that it is a virtual unit. `functions` is None for all or
    unknown; `limits` is the most items for a function, `wide` are registers of four bytes, `read_rules` say what one
    read may take, `holes` are those that it refused in this command.
    """

    @property
    def number(self) -> int | None:
        """See above."""

    name: str
    gateway: Path | None
    is_virtual: bool
    points: tuple[Point, ...]
    functions: frozenset[int] | None
    limits: Mapping[int, int]
    wide: Mapping[str, tuple[Range, ...]]
    read_rules: ReadRules
    holes: Holes

    def ask(self, step: Step) -> Answer:
        """Send a request. Raises DaemonError or NoResponseError."""


def add_unit_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how the unit is reached, and how values are shown."""
    add = parser.add_argument
    add("--swap", choices=("none", "words", "bytes", "both"), default="none", help="order in registers (default none)")
    add("--raw", action="store_true", help="show request and response in hexadecimal too")
    add("--json", action="store_true", help="print JSON instead of a table")
    add_control_argument(parser)
    direct = parser.add_argument_group("without a gateway")
    add_port_arguments(direct, "use")
    add = direct.add_argument
    add("--tcp", metavar="HOST[:PORT]", help="use this Modbus TCP server (default port 502)")
    limit = "time limit (default 1s; 10s with --tcp)"
    add("--timeout", type=parsed_by(parse_duration), metavar="TIME", help=limit)
    add("--profile", metavar="NAME", help="the kind of device, for its points; profile lists them")


class DaemonUnit:
    """A unit of the running gateway.

    Raises:
        DaemonError: the gateway has no such unit.
    """

    def __init__(self, daemon: Conversation, wanted: str) -> None:
        self._daemon = daemon
        unit = daemon.ask(UNIT, OneUnit(int(wanted) if wanted.isdecimal() else wanted))
        self.number = unit.unit
        self.wanted: int | str = unit.name if unit.unit is None else unit.unit
        self.name = unit.name
        self.gateway: Path | None = daemon.gateway
        self.kind = unit.kind
        self.is_virtual = unit.kind == "virtual"
        self.functions = None if unit.functions is None else frozenset(unit.functions)
        self.areas = {Area(area): ranges for area, ranges in unit.areas.items()}
        self.limits = unit.limits
        self.wide = unit.wide
        self.read_rules = unit.read_rules
        self.holes = Holes()
        self.points = unit.points
        daemon.wait_for(unit.longest_wait_ms / 1000 + _SPARE_TIME)

    def ask(self, step: Step) -> Answer:
        """Send a request as the client `control`. Raises DaemonError."""
        pdu = step.pdu
        answer = self._daemon.ask(REQUEST, OneRequest(self.wanted, pdu.hex(" "), step.in_one_turn))
        response, result = bytes.fromhex(answer.pdu or ""), answer.result
        reason = (result in _TOLD_BETTER and answer.reason) or _REASONS.get(result) or answer.reason or result
        head = bytes((self.number or 0,))
        sent, received = head + pdu, head + response
        if answer.sent:
            sent, received = bytes.fromhex(answer.sent), bytes.fromhex(answer.received)
        return Answer(response, answer.elapsed_ms, result, reason, sent, received)
