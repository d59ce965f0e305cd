"""`calibrate`: how long a device really needs, as a timing table for the config."""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from math import ceil
from pathlib import Path
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.daemon import Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.kit.progress import progress
from gateway.cli.kit.usage import WrongUsageError, let_options_stand_anywhere, parsed_by, tell_wrong_usage
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.show.measured_profile import profile_text
from gateway.cli.units.active_calibration import ask_actively, parse_registers
from gateway.cli.units.unit import DaemonUnit
from gateway.config.values.duration import parse_duration, show_duration
from gateway.errors import GatewayError
from gateway.operator.answers.measured import Measured
from gateway.operator.operations import TIMES, OneUnit
from gateway.timing.proposal import MeasuredTimes, Proposal
from gateway.timing.verdict import ENOUGH_TO_SHORTEN

#: How often the gateway is asked for new times, in seconds, and how many are kept for one row here.
_STEP: Final = 1.0
_KEPT: Final = 2000

_EXAMPLES: Final = """\
examples:
  modbus-gateway calibrate press                     from the traffic since the start
  modbus-gateway calibrate press --for 10min         from the traffic of the next ten minutes
  modbus-gateway calibrate press --active            read several sizes of its tables
  modbus-gateway calibrate axis-1 --active --write 10-40 --write-profile axis.toml

Nothing is written to the device unless --write names holding registers: they are
read, and the same values are written back.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `calibrate`."""
    parser.epilog = _EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    add = parser.add_argument
    add("device", help="name or unit ID of a device on a line")
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
    """Measure and print; 1 when nothing was measured.

    Raises:
        GatewayError: the device cannot be asked for, or the file cannot be written.
    """
    try:
        return _run(args)
    except WrongUsageError as wrong:
        return tell_wrong_usage(wrong)


def _run(args: argparse.Namespace) -> int:
    if args.write and not args.active:
        raise WrongUsageError("--write is for --active", "add --active, or leave out --write")
    with Conversation(which_gateway(args)) as daemon:
        unit = DaemonUnit(daemon, args.device)
        source = Source(daemon, unit.number)
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
        advice = "" if args.active else "; --for 10min waits for traffic, --active reads it"
        print(f"{source.about.name}: no normal response{advice}", file=sys.stderr)
        return PROBLEM_FOUND
    more = "a longer --for" if args.active else "--active"
    table = Calibration(source.about, rows, more)
    if args.write_profile:
        _write_new(args.write_profile, _profile(table))
        print(f"{args.write_profile} is written: add it to the config, and name it in the device", file=sys.stderr)
    print(json.dumps(table.picture(), indent=2) if args.json else table.text())
    return FINE


@dataclass(slots=True)
class _Gathered:
    """Responses with one function and number of items: how many, the slowest, and the times of the last ones."""

    count: int = 0
    longest: float = 0.0
    times: list[float] = field(default_factory=list)


class Source:
    """The times that the gateway keeps, gathered: it keeps the last ones only. `about` says what they are of."""

    def __init__(self, daemon: Conversation, unit: int) -> None:
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
        """Only what comes from now on counts."""
        self._gathered.clear()

    @property
    def count(self) -> int:
        """How many responses came."""
        return sum(each.count for each in self._gathered.values())

    def rows(self) -> list[MeasuredTimes]:
        """The times by function and number of items."""
        return [
            MeasuredTimes(*key, tuple(each.times), *self._limits[key], each.longest, each.count)
            for key, each in sorted(self._gathered.items())
            if each.times
        ]


class Calibration(Proposal):
    """The proposal for the device that `about` describes, as text and as JSON. `more` is what brings more responses."""

    def __init__(self, about: Measured, rows: list[MeasuredTimes], more: str) -> None:
        super().__init__(rows, about.margin)
        self.more = more
        self.about = about

    @property
    def count(self) -> int:
        """How many responses came."""
        return sum(row.count for row in self.rows)

    @property
    def timing_text(self) -> str:
        """The table as a key of a profile."""
        rows = [
            f'  {{ fc = {function}, items = {items}, time = "{_duration(seconds)}" }},'
            for function, items, seconds in self.timing
        ]
        return "\n".join(["timing = [", *rows, "]"])

    def text(self) -> str:
        """All of it for a reader."""
        about = self.about
        where = f"{about.mode} {about.baud} {about.format}"
        parts = [
            f"{about.name} (unit {about.unit}), profile {about.profile}, {where}: {self.count} responses",
            align([_HEADINGS, *map(self._cells, self.rows)]),
            f"For the profile, with margin = {self.margin:g}:\n\n{self.timing_text}",
            *self._notes(),
        ]
        return "\n\n".join(parts)

    def picture(self) -> dict[str, Any]:
        """All of it for a program."""
        keys = ("unit", "name", "profile", "mode", "baud", "format")
        rows = [
            {
                "function": row.function,
                "items": row.items,
                "count": row.count,
                "p50_ms": _ms(row.quantile(0.5)),
                "p99_ms": _ms(row.quantile(0.99)),
                "max_ms": _ms(row.slowest),
                "fit_ms": _ms(self.fitted(row)),
                "allowed_ms": row.allowed_ms,
                "limit_ms": row.limit_ms,
            }
            for row in self.rows
        ]
        timing = [{"fc": function, "items": items, "time_ms": _ms(time)} for function, items, time in self.timing]
        return {
            **{key: getattr(self.about, key) for key in keys},
            "rows": rows,
            "timing": timing,
            "margin": self.margin,
        }

    def _cells(self, row: MeasuredTimes) -> tuple[str, ...]:
        times = (row.quantile(0.5), row.quantile(0.99), row.slowest, self.fitted(row), row.limit_ms / 1000)
        return (str(row.function), str(row.items), str(row.count), *(show_duration(each) for each in times))

    def _notes(self) -> Iterator[str]:
        single = [function for function in self.fits if [each[0] for each in self.timing].count(function) == 1]
        several = [function for function in single if function not in _ONE_ITEM]
        if several:
            functions = ", ".join(map(str, several))
            yield f"Only one number of items was seen with function {functions}: --active measures others."
        if self.margin > self.about.margin:
            yield "Some responses take much longer than others: hence the margin."
        kept = max((len(row.times) for row in self.rows if row.count > len(row.times)), default=0)
        if kept:
            yield f"P50 and P99 are those of the last responses only: of {kept} of each kind at most."
        if self.count < ENOUGH_TO_SHORTEN:
            responses = "1 response is" if self.count == 1 else f"{self.count} responses are"
            yield f"{responses} too few for a time limit: take at least {ENOUGH_TO_SHORTEN}, with {self.more}."


_HEADINGS: Final = ("FUNCTION", "ITEMS", "RESPONSES", "P50", "P99", "MAX", "FIT", "LIMIT NOW")
#: Functions whose requests have one item always.
_ONE_ITEM: Final = frozenset({5, 6, 22})


def _wait(source: Source, seconds: float) -> None:
    """Gather times for this long, and show how many there are on a terminal."""
    end = time.monotonic() + seconds
    with progress() as line:
        while (left := end - time.monotonic()) > 0:
            line.show(f"{source.count} responses, {show_duration(max(1, round(left)))} left")
            time.sleep(min(_STEP, left))
            source.look()


def _profile(table: Calibration) -> str:
    about, count = table.about, table.count
    where = f"{about.mode} {about.baud} {about.format}"
    today = datetime.now().astimezone().date()
    origin = f"Measured by modbus-gateway calibrate {about.name}, {today}: {count} responses, {where}."
    return profile_text(about.profile, table.timing_text, table.margin, origin)


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


def _ms(seconds: float) -> float:
    return round(seconds * 1000, 2)


def _duration(seconds: float) -> str:
    """Rounded up to three figures: a limit may be longer than the device needs, not shorter."""
    milliseconds = max(seconds * 1000, 1.0)
    step = 0.01 if milliseconds < 10 else 0.1 if milliseconds < 100 else 1.0
    return show_duration(ceil(round(milliseconds / step, 6)) * step / 1000)
