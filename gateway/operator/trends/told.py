"""The trend of a point, for programs and pages."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import groupby
from math import ceil

from gateway.clock.slices import in_slices
from gateway.clock.times import rfc_3339
from gateway.config.problem import WrongValue
from gateway.config.values.duration import parse_duration
from gateway.errors import ExceptionCode, Malformed, NotPermitted, WrongQuestion
from gateway.operator.operations.answers.trend import PointTrend, TrendSlot
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.asked import TrendOfPoint
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trends.kept import KeptTrends, kept_trends
from gateway.operator.trends.trends import key_of
from gateway.operator.units.reached import device_of, readable_for
from gateway.operator.units.units import picture
from gateway.operator.values.unit_values import point_named
from gateway.profiles.point import Point
from gateway.timing.trend import Slot, mean_of


async def tell_trend(operator: Operator, asked: TrendOfPoint, asker: Asker) -> PointTrend:
    """Return the trend of a point.

    Raises:
        WrongQuestion: there is no such point, the asker may not read it, or no trends are kept.
    """
    unit = picture(operator, asked.device)
    point, trends = point_named(unit, asked.point), trends_of(operator)
    if not readable_for(operator, unit, asker).has(point.read_span):
        why = f"[[access]] does not let you read {point.name} of {unit.name}"
        raise NotPermitted(why, ExceptionCode.ILLEGAL_FUNCTION)
    now, step = operator.clock(), _step(asked.step, trends.layout.step)
    since = now - trends.layout.kept if asked.since is None else _time(asked.since, "since", now)
    until = now if asked.until is None else _time(asked.until, "until", now)
    slots = joined(await slots_of(operator, unit, point, since, until), step)
    told = await in_slices(TrendSlot(rfc_3339(each.time, "seconds"), *each[1:]) for each in slots)
    return PointTrend(device=unit.name, point=point.name, measure=point.unit or None, step_s=step, slots=told)


def trends_of(operator: Operator) -> KeptTrends:
    """Find the trends that are kept.

    Raises:
        WrongQuestion: there are none.
    """
    trends = kept_trends(operator)
    if trends is None:
        raise WrongQuestion('no trends are kept: that needs [web], with values that are not "0"')
    return trends


async def slots_of(operator: Operator, unit: UnitPicture, point: Point, since: float, until: float) -> list[Slot]:
    """Read the slots of a point of a device that begin from `since` on and before `until`, in seconds since 1970.

    Raises:
        WrongQuestion: there is none, or no trends are kept.
    """
    trends, trend = trends_of(operator), trend_of(operator, unit, point)
    if trend is None:
        raise WrongQuestion(f"{unit.name} is not a device: values have trends where they come from")
    now = operator.clock()
    first = trends.layout.slot_at(max(since, now - trends.layout.kept))
    return await trends.slots(trend, first, max(first, min(until, now + 1)))


def trend_of(operator: Operator, unit: UnitPicture, point: Point) -> int | None:
    """Find the number of the trend of a point; None if the unit is not a device."""
    device = device_of(operator.gateway, unit.key)
    return None if device is None else key_of(device.line_name, device.settings.unit, device.name, point)


def joined(slots: Sequence[Slot], step: int) -> Iterator[Slot]:
    """Join slots to longer ones of `step` seconds."""
    for begin, group in groupby(slots, key=lambda slot: slot.time // step * step):
        yield _together(begin, list(group))


def _together(begin: int, slots: Sequence[Slot]) -> Slot:
    least, greatest = min(slot.least for slot in slots), max(slot.greatest for slot in slots)
    return Slot(begin, least, mean_of(sum(slot.mean for slot in slots), len(slots), least, greatest), greatest)


def _step(text: str | None, slot: int) -> int:
    """Find the step that was asked for, or the next longer one that has whole slots.

    Raises:
        Malformed: it is no duration.
    """
    try:
        return slot if text is None else ceil(parse_duration(text) / slot) * slot
    except WrongValue as wrong:
        raise Malformed(f'"step" must be a duration such as 10 min: {wrong}') from None


def _time(text: str, name: str, now: float) -> float:
    """Read a time, or how long ago it is.

    Raises:
        Malformed: it is neither.
    """
    try:
        return now - parse_duration(text)
    except WrongValue:
        pass
    try:
        time = datetime.fromisoformat(text)
        return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        what = f'"{name}" must be a time such as 2026-05-01T08:00:00Z, or how long ago it is, such as 6 h'
        raise Malformed(what) from None
