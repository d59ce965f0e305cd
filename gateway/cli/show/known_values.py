"""The latest known values as `values` prints them: a row for each point."""

from typing import Final

from gateway.cli.kit.columns import align, narrow
from gateway.cli.kit.paint import dim, red, yellow
from gateway.config.values.duration import show_age
from gateway.operator.operations.answers.known_values import KnownValue, KnownValues

_HEADINGS: Final = ("DEVICE", "POINT", "VALUE", "UNIT", "STATE", "AGE", "SOURCE")
#: The columns that may be shortened.
_FLEXIBLE: Final = (0, 1, 2, 6)
#: From this age on tenths of a second do not matter, in milliseconds.
_LONG: Final = 10_000


def values_as_text(known: KnownValues, width: int) -> str:
    """Show values for people, `width` characters wide unless they are too long; and what to do if there is none."""
    rows = [_HEADINGS, *(_row(each) for each in known.values)]
    table = align(narrow(rows, _FLEXIBLE, width)) if known.values else ""
    return "\n".join(filter(None, (table, known.hint))) or "no point can be read here: see the rows of [[access]]"


def _row(each: KnownValue) -> tuple[str, ...]:
    return (
        each.name,
        each.point,
        each.text,
        each.measure or "",
        _painted(each.state),
        _age(each.age_ms),
        each.source or "",
    )


def _painted(state: str) -> str:
    return {"invalid": red, "stale": yellow, "never": dim}.get(state, str)(state)


def _age(age_ms: float | None) -> str:
    if age_ms is None:
        return ""
    return f"{age_ms / 1000:.1f} s" if age_ms < _LONG else show_age(age_ms)
