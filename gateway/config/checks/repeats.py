"""Cross-checks of repeated reads."""

from collections.abc import Iterator
from math import ceil

from gateway.config.checks.units import client_lines
from gateway.config.plan.forecast import least_for_repeat
from gateway.config.plan.resolve import resolve
from gateway.config.problem import Problem, warning
from gateway.config.schema.root import Config, Line
from gateway.config.values.duration import show_duration


def check_repeats(config: Config) -> Iterator[Problem]:
    """`retry_within` means something, and leaves time for one repeat. The config must have passed all other checks."""
    lines = client_lines(config)
    if all(line.retry_within is None for line in lines):
        return
    for line, plan in zip(lines, resolve(config).lines, strict=True):
        yield from _check(line, least_for_repeat(plan))


def _check(line: Line, needed: float) -> Iterator[Problem]:
    path = (*line.path, "retry_within")
    if line.retry_within is None:
        return
    if not line.retries:
        yield warning(path, "has no effect without retries", "add retries = 1, or leave it out")
    elif line.retry_within < needed:
        what = f"is too short for one repeat after silence (needs {show_duration(_round_up(needed))})"
        remedy = "make it longer, or timeout or late_window shorter; otherwise only damaged responses are repeated"
        yield warning(path, what, remedy)


def _round_up(seconds: float) -> float:
    """Round up to three digits, as `show_duration` shows."""
    return ceil(seconds) if seconds > 10 else ceil(seconds * 100) / 100
