"""`check`: how long trends of points are kept, and for how many points there is room."""

from gateway.config.plan.settings import Plan
from gateway.config.values.duration import show_duration
from gateway.operator.trends.numbers import has_trend
from gateway.timing.trend import SHORT, Layout


def trends_as_text(plan: Plan) -> list[str]:
    """Show slots and room, if any trend is kept."""
    points = _points(plan)
    if plan.web is None or not plan.web.values or not points:
        return []
    layout = Layout.of(plan.web.values)
    room = f"room for about {layout.points // 100 * 100} points that always change"
    here = f"{points} point{'' if points == 1 else 's'} here"
    enough = "" if points <= layout.points else ": the oldest slots are dropped earlier, if more than that change"
    return [f"Trends\n  kept for {_time(layout.kept)} in slots of {layout.step // 60} min; {room}, {here}{enough}"]


def trends_as_json(plan: Plan) -> dict[str, int] | None:
    """Make the same for programs; None if no trends are kept."""
    if plan.web is None or not plan.web.values:
        return None
    layout = Layout.of(plan.web.values)
    return {"kept_s": layout.kept, "step_s": layout.step, "room_for_points": layout.points, "points": _points(plan)}


def _points(plan: Plan) -> int:
    """Count the points of devices that have a trend."""
    return sum(has_trend(point) for device in plan.shared for point in plan.points.get(device.known_as, ()))


def _time(seconds: int) -> str:
    if seconds > SHORT and seconds % SHORT == 0:
        return f"{seconds // SHORT} days"
    return show_duration(seconds) if seconds % 3600 else f"{seconds // 3600} h"
