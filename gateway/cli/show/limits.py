"""Time limits and longest waits, as `check` and `profile` show them."""

from math import ceil, floor, log10
from typing import Any

from gateway.cli.kit.columns import align
from gateway.config.plan.forecast import (
    FunctionLimits,
)
from gateway.config.values.duration import show_duration


def limits_table(limits: tuple[FunctionLimits, ...], indent: str) -> str:
    """Show the limits of each function as a table."""
    rows = [
        (
            "others" if one.function is None else str(one.function),
            show_duration(one.one_item),
            str(one.most) if one.most else "-",
            show_duration(one.most_items),
        )
        for one in limits
    ]
    return align([("FUNCTION", "LIMIT FOR 1 ITEM", "MOST ITEMS", "LIMIT FOR MOST"), *rows], indent)


def limits_as_json(limits: tuple[FunctionLimits, ...]) -> list[dict[str, Any]]:
    """Make the limits of each function for programs; `function` is None for all others."""
    return [
        {
            "function": one.function,
            "one_item_ms": milliseconds(one.one_item),
            "most_items": one.most,
            "most_items_ms": milliseconds(one.most_items),
        }
        for one in limits
    ]


def round_up(seconds: float) -> str:
    """Show a time, rounded up to the three digits that are shown."""
    if not seconds:
        return "at once"
    step = max(0.01, 10.0 ** (floor(log10(seconds)) - 2))
    return show_duration(ceil(seconds / step) * step)


def milliseconds(seconds: float) -> float:
    """Turn a time into that of JSON output."""
    return round(seconds * 1000, 3)
