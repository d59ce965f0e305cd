"""What `check` shows of the time of a line or upstream: what its polls take, and how often devices can be read."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from gateway.cli.kit.columns import align, without_middles
from gateway.config.plan.line_load import PollLoad, ReadRate, load_of, total_share
from gateway.config.plan.settings import LinePlan, OwnerPlan, Plan
from gateway.config.values.duration import show_duration


def polls_as_text(owner: OwnerPlan, plan: Plan) -> Iterator[str]:
    """Show a table of the declared polls of a line or upstream, if it has any."""
    load = load_of(owner, plan)
    if load:
        rows = [(", ".join(each.by), each.of.name, str(each.poll), show_duration(each.poll.every),
                 _time(one.time) if one.time else "-", _percent(one.share) if one.time else "-")
                for one in load for each in (one.declared,)]  # fmt: skip
        of, time = ("line", "LINE TIME") if isinstance(owner, LinePlan) else ("connection", "TIME")
        table = align([("BY", "OF", "READS", "EVERY", time, "SHARE"), *without_middles(rows, (1,))], "    ")
        yield f"  Declared polls take {_total(load)} of the {of}{_assumed(load)}{_bridged(load)}\n{table}"


def _total(load: tuple[PollLoad, ...]) -> str:
    if not any(one.time for one in load):
        return "an unknown share"
    at_least = "" if all(one.has_time for one in load) else "at least "
    return f"{at_least}{_percent(total_share(load))}"


def _assumed(load: tuple[PollLoad, ...]) -> str:
    """Say whose answer times are not in the sum."""
    profiles = dict.fromkeys(one.declared.of.profile.name for one in load if not one.has_time)
    return f" (answer times not known: {', '.join(profiles)})" if profiles else ""


def _bridged(load: tuple[PollLoad, ...]) -> str:
    """Say how few requests are sent because they read over gaps; nothing if none does."""
    over = sum(one.declared.poll.bridged for one in load)
    if not over:
        return ""
    all_wanted = [each for one in load for each in one.declared.wanted]
    points = sum(each.is_point for each in all_wanted)
    ranges = len(all_wanted) - points
    wanted = " and ".join(f"{count} {what}" for count, what in ((points, "points"), (ranges, "ranges")) if count)
    return f"\n    {len(load)} requests for {wanted}, over {over} addresses between them (max_gap)"


def rates_as_text(rates: Sequence[ReadRate], of: str) -> Iterator[str]:
    """Show how often the devices that `of` names can be read at most."""
    rows = [(str(one.items), _time(one.time), _rate(one.alone), _rate(one.in_turn)) for one in rates]
    if rates:
        area, has_time = rates[0].area, rates[0].has_time
        assumed = "" if has_time else "\n    (its profile has no answer times: as if it answered at once)"
        table = align([(area.upper(), "LINE TIME", "READS/S ALONE", "READS/S WITH ALL IN TURN"), *rows], "    ")
        yield f"  Reads at most, of {of}{assumed}\n{table}"


def polls_as_json(load: Iterable[PollLoad]) -> list[dict[str, Any]]:
    """Make the declared polls for programs: times in milliseconds, and shares of the line's time."""
    return [
        {
            "by": one.declared.by,
            "of": one.declared.of.name,
            "addresses": str(one.declared.poll),
            "wanted": len(one.declared.wanted),
            "bridged": one.declared.poll.bridged,
            "every_ms": round(1000 * one.declared.poll.every, 3),
            "line_time_ms": round(1000 * one.time, 3),
            "share": round(one.share, 4),
            "answer_time_known": one.has_time,
        }
        for one in load
    ]


def rates_as_json(rates: Iterable[ReadRate]) -> list[dict[str, Any]]:
    """Make for programs how often a device can be read at most, alone and with all devices of its line in turn."""
    return [
        {
            "area": one.area,
            "items": one.items,
            "line_time_ms": round(1000 * one.time, 3),
            "per_second": _rounded(one.alone),
            "per_second_in_turn": _rounded(one.in_turn),
            "answer_time_known": one.has_time,
        }
        for one in rates
    ]


def _time(seconds: float) -> str:
    return f"{1000 * seconds:.1f} ms"


def _rounded(per_second: float | None) -> float | None:
    return None if per_second is None else round(per_second, 3)


def _rate(per_second: float | None) -> str:
    return "-" if per_second is None else f"{per_second:.1f}" if per_second < 100 else f"{per_second:.0f}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
