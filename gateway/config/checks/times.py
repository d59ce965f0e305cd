"""Cross-checks of what the plan tells: repeated reads, the time that polls need, and how long a lease must be."""

from collections.abc import Iterator
from math import ceil
from typing import Final

from gateway.config.plan.forecast import guard, least_for_repeat
from gateway.config.plan.line_load import FULL, load_of, total_share
from gateway.config.plan.names import owners
from gateway.config.plan.reach import client_lines
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.values.duration import show_duration
from gateway.timing.lease_time import HOLDS

#: A holder can write for at least this many seconds after each renewal: in this time it renews three times, by network.
_LEAST: Final = 0.6


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


def check_load(config: Config, plan: Plan) -> Iterator[Problem]:
    """Find lines and upstreams that have no time for anything but their declared polls."""
    for owner, of_plan in zip(owners(config), plan.owners, strict=True):
        load = load_of(of_plan, plan)
        share = total_share(load)
        if share >= FULL:
            at_least = "" if all(each.has_time for each in load) else "at least "
            what = f"the polls of {_pollers(config)} need {at_least}{share:.0%} of its time"
            faster = ", or raise the rate of the line" if isinstance(owner, Line) else ""
            yield warning(owner.path, what, f"poll less often{faster}")


def _pollers(config: Config) -> str:
    pollers = {
        "mirrors": any(image.of is not None for image in config.image),
        "virtual units": any(image.map for image in config.image),
        "MQTT": config.mqtt is not None,
    }
    return " and ".join(name for name, polls in pollers.items() if polls)


def check_lease(config: Config, plan: Plan) -> Iterator[Problem]:
    """Find leases that are shorter than a transaction on their line may be."""
    fleet = config.fleet
    if fleet is None or all(line.lease is None for line in config.line):
        return
    if fleet.fallback == "hold":
        what = "lets two gateways ask on one line while NATS cannot be reached: their frames may collide"
        yield warning((*fleet.path, "fallback"), what, 'fallback = "release" lets nobody ask then')
    for line, settings in zip(client_lines(config), plan.lines, strict=True):
        guarded = guard(settings)
        if line.lease is not None and HOLDS * fleet.lease - guarded < _LEAST:
            longest = f"a transaction may take {show_duration(round(guarded, 2))}"
            remedy = f'set lease = "{ceil((guarded + _LEAST) / HOLDS)} s" or longer in [fleet]'
            yield error(
                (*line.path, "lease"), f"{longest}: too long for a lease of {show_duration(fleet.lease)}", remedy
            )
