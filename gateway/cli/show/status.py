"""The status of a gateway as text for people."""

import sys
import textwrap
from typing import Final

from gateway.cli.show.advice import notes
from gateway.cli.show.status_tables import TABLES, was_asked
from gateway.operator.answers.status import Status

_INDENT: Final = "  "


def show_status(status: Status, width: int = 80, *, is_cut: bool = True) -> str:
    """Show the status as tables, `width` characters wide unless names and addresses are too long.

    Unless it `is_cut`, no name is shortened: for a file, or a program that looks for one.
    """
    parts = ["   ".join(fact for fact in (status.site, status.page) if fact)]
    parts += [table.show(status, width if is_cut else sys.maxsize) for table in TABLES]
    parts.append(_show_notes(status, width))
    silent = sum(not was_asked(unit) for unit in status.units)
    if silent:
        parts.append(f"{silent} unit{' has' if silent == 1 else 's have'} not been polled yet.")
    return "\n\n".join(part for part in parts if part)


def _show_notes(status: Status, width: int) -> str:
    """Show the notes, a paragraph for each."""
    told = [
        textwrap.fill(
            f"{about}: {note}", width, initial_indent=_INDENT, subsequent_indent=2 * _INDENT, break_on_hyphens=False
        )
        for about, note in notes(status)
    ]
    return "\n".join(["Notes", *told]) if told else ""
