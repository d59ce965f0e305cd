"""Cross-checks of `lease`: what it needs, and how long it must be."""

from collections.abc import Iterator
from math import ceil
from typing import Final

from gateway.config.plan.forecast import guard
from gateway.config.plan.reach import client_lines
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.values.duration import show_duration
from gateway.timing.lease_time import HOLDS

#: A holder can write for at least this many seconds after each renewal: in this time it renews three times, by network.
_LEAST: Final = 0.6


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
