"""`calibrate`: how long a device really needs, as a timing table for the config."""

import argparse
import json
import shlex
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.kit.progress import progress
from gateway.cli.kit.usage import WrongUsageError, let_options_stand_anywhere, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.show.calibration import Calibration, measured_profile
from gateway.cli.units.active_calibration import ask_actively, parse_registers
from gateway.cli.units.unit import DaemonUnit
from gateway.config.values.duration import parse_duration, show_duration
from gateway.errors import DaemonError, GatewayError
from gateway.operator.operations.answers.times import Measured
from gateway.operator.operations.asked import OneUnit
from gateway.operator.operations.table import TIMES
from gateway.timing.proposal import MeasuredTimes

#: How often the gateway is asked for new times, in seconds, and how many are kept for one row here.
_STEP: Final = 1.0
_KEPT: Final = 2000

_ABOUT: Final = """\
Nothing is written to the device unless --write names holding registers: they are
read, and the same values are written back.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate`."""
    parser.epilog = _ABOUT
    add = parser.add_argument
    add("device", help="name or unit ID of a device")
    add(
        "--for",
        dest="seconds",
        type=parsed_by(parse_duration),
        metavar="TIME",
        help="how long to measure, such as 10min",
    )
    add("--active", action="store_true", help="read several sizes of each table (10 rounds, or as long as --for says)")
    add(
        "--write",
        type=parsed_by(parse_registers),
        metavar="ADDRESS",
        help="with --active: read registers such as 10-40, and write the same values back",
    )
    add("--write-profile", type=Path, metavar="FILE", help="write a profile with these times to a new file")
    add("--json", action="store_true", help="print JSON instead of tables")
    add_control_argument(parser)
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Measure and print; 1 when nothing was measured."""
    if args.write and not args.active:
        raise WrongUsageError("--write is for --active", "add --active, or leave out --write")
    with Conversation(which_gateway(args)) as daemon:
        unit = DaemonUnit(daemon, args.device)
        if args.active and unit.kind == "heard":
            raise DaemonError(f"others ask {unit.name}, and the gateway only listens there: leave out --active")
        source = Source(daemon, unit.wanted, is_heard=unit.kind == "heard")
        if args.active or args.seconds is not None:
            source.forget()
        if args.write:
            tell_which(daemon.gateway)
        if args.active:
            _ask(source, unit, args)
        elif args.seconds is not None:
            _wait(source, args.seconds)
        source.look()
        return _show(source, args)


def _ask(source: "Source", unit: DaemonUnit, args: argparse.Namespace) -> None:
    """Ask what is to be measured, and show how many responses there are on a terminal."""
    with progress() as line:
        for trouble in ask_actively(unit, args.write, args.seconds):
            source.look()
            line.show(f"{source.count} responses")
            if trouble:
                line.clear()
                print(trouble, file=sys.stderr)


def _show(source: "Source", args: argparse.Namespace) -> int:
    rows = source.rows()
    if not rows:
        active = "" if source.is_heard else ", --active reads it"
        advice = "" if args.active else f"; --for 10min waits for traffic{active}"
        print(f"{source.about.name}: no normal response{advice}", file=sys.stderr)
        return PROBLEM_FOUND
    more = "a longer --for" if args.active or source.is_heard else "--active"
    table = Calibration(source.about, rows, more)
    if args.write_profile:
        _write_new(args.write_profile, measured_profile(table))
        add = f"modbus-gateway profile add {shlex.quote(str(args.write_profile))}"
        print(f"{args.write_profile} is written: {add}, and name it in the device", file=sys.stderr)
    print(json.dumps(table.picture(), indent=2) if args.json else table.text())
    return FINE


@dataclass(slots=True)
class _Gathered:
    """Responses with one function and number of items: how many, the slowest, and the times of the last ones."""

    count: int = 0
    longest: float = 0.0
    times: list[float] = field(default_factory=list)


class Source:
    """The times that the gateway keeps, gathered: it keeps the last ones only. `about` says what they are of.

    If the unit `is_heard`, only others ask it.
    """

    def __init__(self, daemon: Conversation, unit: int | str, *, is_heard: bool) -> None:
        self.is_heard = is_heard
        self._daemon = daemon
        self._unit = unit
        self._gathered: dict[tuple[int, int], _Gathered] = {}
        #: What the gateway said last: how many responses since its start, and the slowest of these.
        self._said: dict[tuple[int, int], tuple[int, float]] = {}
        self._limits: dict[tuple[int, int], tuple[float, float]] = {}
        self.about = self.look()

    def look(self) -> Measured:
        """Take what is new."""
        self.about = self._daemon.ask(TIMES, OneUnit(self._unit))
        for row in self.about.rows:
            key, longest = (row.function, row.items), row.longest_ms / 1000
            count_before, longest_before = self._said.get(key, (0, 0.0))
            new = row.count - count_before if row.count >= count_before else row.count  # after a reload
            if new > 0:
                gathered = self._gathered.setdefault(key, _Gathered())
                gathered.count += new
                gathered.times += [each / 1000 for each in row.times_ms[-new:]]
                del gathered.times[:-_KEPT]
                if longest > longest_before:
                    gathered.longest = max(gathered.longest, longest)
            self._said[key] = row.count, longest
            self._limits[key] = row.limit_ms, row.allowed_ms
        return self.about

    def forget(self) -> None:
        """Forget what was gathered: only what comes from now on counts."""
        self._gathered.clear()

    @property
    def count(self) -> int:
        """Count the responses."""
        return sum(each.count for each in self._gathered.values())

    def rows(self) -> list[MeasuredTimes]:
        """List the times by function and number of items."""
        return [
            MeasuredTimes(*key, tuple(each.times), *self._limits[key], each.longest, each.count)
            for key, each in sorted(self._gathered.items())
            if each.times
        ]


def _wait(source: Source, seconds: float) -> None:
    """Gather times for this long, and show how many there are on a terminal."""
    end = time.monotonic() + seconds
    with progress() as line:
        while (left := end - time.monotonic()) > 0:
            line.show(f"{source.count} responses, {show_duration(max(1, round(left)))} left")
            time.sleep(min(_STEP, left))
            source.look()


def _write_new(file: Path, text: str) -> None:
    """Write a file that is not there yet.

    Raises:
        GatewayError: it is there, or cannot be written.
    """
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except OSError as error:
        raise GatewayError(f"{file}: {error.strerror}") from error
