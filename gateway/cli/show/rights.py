"""The access rights as `check` prints them."""

from typing import Any

from gateway.cli.kit.columns import align
from gateway.config.plan.rights_in_words import (
    own_numbers,
    right_in_words,
    rows_in_words,
    unnamed_certified,
    unnamed_datagrams,
)
from gateway.config.plan.settings import Plan
from gateway.routing.access import DEFAULT_ROWS


def rights_as_text(plan: Plan) -> str:
    """Show the table of rights, with rules that are not rows."""
    rows = [("FROM", "THROUGH", "UNITS", "RIGHTS"), *(row[:4] for row in rows_in_words(plan))]
    silent = [f"  Through {name} (UDP) clients only read, as no row names it." for name in unnamed_datagrams(plan)]
    silent += [f"  Through {name} (TLS) {_by_certificate(plan)}." for name in unnamed_certified(plan)]
    return "\n".join(["Rights: first match wins", align(rows, "  "), *silent])


def _by_certificate(plan: Plan) -> str:
    if plan.access == DEFAULT_ROWS:
        return "clients only read, from everywhere, as there are no rows"
    return "only rows with a role apply, as no row names it"


def rights_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the table of rights for programs; null means all."""
    return [
        {
            "from": None if row.networks is None else [*map(str, row.networks), *sorted(row.sites)],
            "role": row.role,
            "listen": None if row.listeners is None else sorted(row.listeners),
            "units": None if row.units is None else sorted(row.units),
            "by_address": bool(own_numbers(row, plan)),
            "may": right_in_words(row.right),
            "source": row.source,
        }
        for row in plan.access
    ]
