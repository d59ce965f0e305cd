"""Cross-checks of repeated reads."""

from collections.abc import Iterator
from math import ceil

from gateway.config.plan.forecast import least_for_repeat
from gateway.config.plan.reach import client_lines
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, warning
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.values.duration import show_duration


def check_retries(config: Config, plan: Plan) -> Iterator[Problem]:
    """Find lines whose `retry_within` has no effect, or leaves no time for one repeat."""
    for line, settings in zip(client_lines(config), plan.lines, strict=True):
        if line.retry_within is not None:
            yield from _check(line, line.retry_within, least_for_repeat(settings))


def _check(line: Line, retry_within: float, needed: float) -> Iterator[Problem]:
    path = (*line.path, "retry_within")
    if not line.retries:
        yield warning(path, "has no effect without retries", "add retries = 1, or leave it out")
    elif retry_within < needed:
        what = f"is too short for one repeat after silence (needs {show_duration(_round_up(needed))})"
        remedy = "make it longer, or timeout or late_window shorter; otherwise only damaged responses are repeated"
        yield warning(path, what, remedy)


def _round_up(seconds: float) -> float:
    """Round up to three digits, as `show_duration` shows."""
    return ceil(seconds) if seconds > 10 else ceil(seconds * 100) / 100
