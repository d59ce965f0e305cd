"""The status of a gateway as text for people: what is wrong first, then tables, bad rows first."""

import sys
from collections.abc import Iterator
from typing import Final

from gateway.cli.kit.cells import wrapped
from gateway.cli.kit.paint import red
from gateway.cli.show.advice import Note, called, notes
from gateway.cli.show.status_tables import TABLES, was_asked
from gateway.operator.answers.status import Status
from gateway.operator.answers.trouble import Trouble, worst_first

_INDENT: Final = "  "


def show_status(status: Status, width: int = 80, *, is_cut: bool = True) -> str:
    """Show the status as tables, `width` characters wide unless names and addresses are too long.

    Unless it `is_cut`, no name is shortened: for a file, or a program that looks for one.
    """
    about = list(notes(status))
    wrong = _what_is_wrong(status.troubles, about, status, width)
    told = {(each.page, each.name) for each in status.troubles}
    others = [note for note in about if (note.page, note.name) not in told]
    return "\n\n".join([*wrong, *_parts(status, others, width if is_cut else sys.maxsize, width)])


def _parts(status: Status, others: list[Note], width: int, prose_width: int) -> Iterator[str]:
    facts = [fact for fact in (status.site, status.page) if fact]
    if facts:
        yield "   ".join(facts)
    for table in TABLES:
        text = table.show(status, width)
        if text:
            yield text
    if others:
        yield "\n".join(["Notes", *_paragraphs(others, prose_width)])
    silent = sum(not was_asked(unit) for unit in status.units)
    if silent:
        yield f"{silent} unit{' has' if silent == 1 else 's have'} not been asked yet."


def _what_is_wrong(troubles: tuple[Trouble, ...], about: list[Note], status: Status, width: int) -> list[str]:
    """Write a line or more for each trouble, the worst first, in one text; nothing if there is none."""
    names = {unit.name: called(unit) for unit in status.units}
    told: list[str] = []
    for trouble in worst_first(troubles):
        name = names.get(trouble.name, trouble.name) if trouble.page == "units" else trouble.name
        texts = [each.text for each in about if (each.page, each.name) == (trouble.page, trouble.name)]
        for text in texts or [_in_words(trouble)]:
            told += wrapped(f"{red(name)}: {text}", width, _INDENT, 2 * _INDENT)
    return ["\n".join([red("What is wrong"), *told])] if told else []


def _in_words(trouble: Trouble) -> str:
    if trouble.kind == "full":
        return f"busy for {trouble.share:.0%} of the time"
    if trouble.page != "units" or not trouble.requests:
        return f"{trouble.kind}: {trouble.reason}"
    lost = f"{trouble.share:.0%} of {trouble.requests} requests without an answer in the last minutes"
    return f"{lost}; last was {trouble.reason}" if trouble.reason else lost


def _paragraphs(about: list[Note], width: int) -> Iterator[str]:
    for note in about:
        yield from wrapped(str(note), width, _INDENT, 2 * _INDENT)
