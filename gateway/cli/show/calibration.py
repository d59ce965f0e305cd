"""A proposed timing table, as `calibrate` prints it and as a profile."""

import re
from collections.abc import Iterator
from datetime import datetime
from math import ceil
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.config.values.duration import show_duration
from gateway.operator.operations.answers.times import Measured
from gateway.profiles import shipped_text
from gateway.timing.proposal import MeasuredTimes, Proposal
from gateway.timing.verdict import ENOUGH_TO_SHORTEN

_HEADINGS: Final = ("FUNCTION", "ITEMS", "RESPONSES", "P50", "P99", "MAX", "FIT", "LIMIT NOW")
#: Functions whose requests have one item always.
_ONE_ITEM: Final = frozenset({5, 6, 22})
_COMMENT: Final = re.compile(r"\A(#.*\n)*\n*")
_HEADING: Final = re.compile(r"^\[profile\.[^]]*\]\n", re.MULTILINE)
_TIMING: Final = re.compile(r"^timing\s*=\s*\[\n.*?^\]\n", re.MULTILINE | re.DOTALL)
_MARGIN: Final = re.compile(r"^margin\s*=.*\n", re.MULTILINE)


class Calibration(Proposal):
    """The proposal for the device that `about` describes, as text and as JSON. `more` is what brings more responses."""

    def __init__(self, about: Measured, rows: list[MeasuredTimes], more: str) -> None:
        super().__init__(rows, about.margin)
        self.more = more
        self.about = about

    @property
    def count(self) -> int:
        """Count the responses."""
        return sum(row.count for row in self.rows)

    @property
    def timing_text(self) -> str:
        """Write the table as a key of a profile."""
        rows = [
            f'  {{ fc = {function}, items = {items}, time = "{_duration(seconds)}" }},'
            for function, items, seconds in self.timing
        ]
        return "\n".join(["timing = [", *rows, "]"])

    def text(self) -> str:
        """Show all of it for people."""
        about = self.about
        called = about.name if about.unit is None else f"{about.name} (unit {about.unit})"
        parts = [
            f"{called}, profile {about.profile}, {_where(about)}: {self.count} responses",
            align([_HEADINGS, *map(self._cells, self.rows)]),
            f"For the profile, with margin = {self.margin:g}:\n\n{self.timing_text}",
            *self._notes(),
        ]
        return "\n\n".join(parts)

    def picture(self) -> dict[str, Any]:
        """Make all of it for programs."""
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


def measured_profile(table: Calibration) -> str:
    """Make the text of a profile with these times."""
    about, count = table.about, table.count
    today = datetime.now().astimezone().date()
    origin = f"Measured by modbus-gateway calibrate {about.name}, {today}: {count} responses, {_where(about)}."
    return profile_text(about.profile, table.timing_text, table.margin, origin)


def _where(about: Measured) -> str:
    return f"{about.mode} {about.baud} {about.format}" if about.baud else "Modbus TCP"


def _ms(seconds: float) -> float:
    return round(seconds * 1000, 2)


def _duration(seconds: float) -> str:
    """Show a time rounded up to three figures: a limit may be longer than the device needs, not shorter."""
    milliseconds = max(seconds * 1000, 1.0)
    step = 0.01 if milliseconds < 10 else 0.1 if milliseconds < 100 else 1.0
    return show_duration(ceil(round(milliseconds / step, 6)) * step / 1000)


def profile_text(profile: str, timing: str, margin: float, origin: str) -> str:
    """Write the TOML table of the profile `NAME-measured`, with a `timing` key as text, and where that comes from."""
    name = f"{profile}-measured"
    key = f"{timing}\nmargin    = {margin:g}\n"
    shipped = shipped_text(profile)
    if shipped is None:
        return f"# {origin}\n# Add the other keys of [profile.{profile}].\n\n[profile.{name}]\n{key}"
    text = _COMMENT.sub("", shipped)
    text = _MARGIN.sub("", _TIMING.sub("", text))
    return f"# {origin}\n# All else is as in the shipped profile {profile}.\n\n" + _HEADING.sub(
        lambda _: f"[profile.{name}]\n{key}", text, count=1
    )
