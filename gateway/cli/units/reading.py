"""Carry out steps on a unit, one request after the other, and read its points."""

from collections.abc import Sequence

from gateway.cli.units.unit import Unit
from gateway.operator.values.steps import Outcome, Steps, reading
from gateway.profiles.point import Point


def read_points(unit: Unit, points: Sequence[Point]) -> Outcome:
    """Read points in as few requests as the unit allows.

    Raises:
        DaemonError, NoResponseError: there is no response.
    """
    return carry_out(unit, reading(points, unit.read_rules, unit.holes))


def carry_out(unit: Unit, steps: Steps) -> Outcome:
    """Send each request, and give the answer to the next step.

    Raises:
        DaemonError, NoResponseError: there is no response.
    """
    try:
        step = next(steps)
        while True:
            step = steps.send(unit.ask(step))
    except StopIteration as end:
        outcome: Outcome = end.value
        return outcome
