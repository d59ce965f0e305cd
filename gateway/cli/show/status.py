"""The status of a gateway, or of the sites of a fleet, as text for people."""

import textwrap
from typing import Any, Final, TypeVar

from gateway.cli.kit.columns import align, narrow
from gateway.cli.show.advice import notes
from gateway.cli.show.status_tables import SITES, TABLES, Table, was_asked
from gateway.operator.answers.fleet import Sites
from gateway.operator.answers.status import Status

W = TypeVar("W")

_INDENT: Final = "  "
#: The columns whose texts may be shortened.
_FLEXIBLE: Final = frozenset(
    {"NAME", "PORT", "ADDRESS", "AT", "DEVICE", "OF", "AGES", "CLIENT", "LISTENER", "REASON", "DOWN"}
)


def show_status(status: Status, width: int = 80) -> str:
    """Show the status as tables, `width` characters wide unless names and addresses are too long."""
    parts = ["   ".join(fact for fact in (status.site, status.page) if fact)]
    parts += [_show(table, status, width) for table in TABLES]
    parts.append(_show_notes(status, width))
    silent = sum(not was_asked(unit) for unit in status.units)
    if silent:
        parts.append(f"{silent} unit{' has' if silent == 1 else 's have'} not been polled yet.")
    return "\n\n".join(part for part in parts if part)


def show_sites(sites: Sites, width: int = 80) -> str:
    """Show the sites of a fleet as a table."""
    return _show(SITES, sites, width)


def _show(table: Table[W, Any], whole: W, width: int) -> str:
    """Show a table; nothing if it has no rows."""
    cells = [[str(cell(row)) for cell in table.columns.values()] for row in table.rows(whole)]
    if not cells:
        return ""
    flexible = [place for place, heading in enumerate(table.columns) if heading in _FLEXIBLE]
    rows = narrow([tuple(table.columns), *cells], flexible, width - len(_INDENT))
    return f"{table.title}\n{align(rows, _INDENT)}"


def _show_notes(status: Status, width: int) -> str:
    """Show the notes, a paragraph for each."""
    told = [
        textwrap.fill(f"{about}: {note}", width, initial_indent=_INDENT, subsequent_indent=2 * _INDENT)
        for about, note in notes(status)
    ]
    return "\n".join(["Notes", *told]) if told else ""
