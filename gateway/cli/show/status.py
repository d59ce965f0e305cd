"""The status of a gateway as text for people: what is wrong first, then tables, bad rows first."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gateway.cli.kit.cells import wrapped
from gateway.cli.kit.paint import red
from gateway.cli.kit.watching import Screen
from gateway.cli.show.advice import Note, called, notes
from gateway.cli.show.status_tables import TABLES, was_asked
from gateway.operator.operations.answers.status import Status
from gateway.operator.operations.answers.trouble import Trouble, worst_first

_INDENT: Final = "  "


def show_status(status: Status, width: int = 80, *, is_cut: bool = True) -> str:
    """Show the status as tables, `width` characters wide unless names and addresses are too long.

    Unless it `is_cut`, no name is shortened: for a file, or a program that looks for one.
    """
    screen = status_screen(status, width if is_cut else sys.maxsize, prose_width=width)
    return "\n".join([*screen.wrong, *([""] if screen.wrong else []), *screen.lines])


def status_screen(status: Status, width: int, part: str = "", *, prose_width: int = 0) -> Screen:
    """Show what is wrong, and below it the tables: all of them, or what belongs to the line or upstream `part`."""
    about = list(notes(status))
    wrong = _what_is_wrong(status.troubles, about, status, prose_width or width)
    names = _lines(status)
    shown = only(status, part) if part in names else status
    told = {(each.page, each.name) for each in status.troubles}
    others = [note for note in about if (note.page, note.name) not in told and _is_about(note, shown)]
    lines = "\n\n".join(_parts(shown, others, width, prose_width or width)).splitlines()
    return Screen(lines, wrong, names)


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


def only(status: Status, line: str) -> Status:
    """Leave out of a status what does not belong to a line or upstream."""
    units = tuple(unit for unit in status.units if unit.line == line)
    devices = {unit.name for unit in units}
    return replace(
        status,
        lines=tuple(each for each in status.lines if each.name == line),
        servers=tuple(each for each in status.servers if each.name == line),
        upstreams=tuple(each for each in status.upstreams if each.name == line),
        monitors=tuple(each for each in status.monitors if each.name == line),
        units=units,
        moved=tuple(each for each in status.moved if each.line == line),
        leases=tuple(each for each in status.leases if each.line == line),
        mirrors=tuple(each for each in status.mirrors if each.of in devices),
        virtual=tuple(each for each in status.virtual if devices & {source.device for source in each.sources}),
        images=(),
        listeners=(),
        clients=(),
        rejections=(),
        brokers=(),
        fleets=(),
        certificates=(),
        state_files=(),
    )


def _is_about(note: Note, status: Status) -> bool:
    units = [unit.name for unit in status.units] + [unit.name for unit in status.moved]
    return note.name in (_lines(status) if note.page == "lines" else units)


def _lines(status: Status) -> list[str]:
    return [line.name for line in status.all_lines]


def _what_is_wrong(troubles: tuple[Trouble, ...], about: list[Note], status: Status, width: int) -> list[str]:
    """Write a paragraph for each trouble, the worst first; nothing if there is none."""
    names = {unit.name: called(unit) for unit in status.units}
    told: list[str] = []
    for trouble in worst_first(troubles):
        name = names.get(trouble.name, trouble.name) if trouble.page == "units" else trouble.name
        texts = [each.text for each in about if (each.page, each.name) == (trouble.page, trouble.name)]
        for text in texts or [_in_words(trouble)]:
            told += wrapped(f"{red(name)}: {text}", width, _INDENT, 2 * _INDENT)
    return [red("What is wrong"), *told] if told else []


def _in_words(trouble: Trouble) -> str:
    if trouble.kind == "full":
        return f"busy for {trouble.share:.0%} of the time"
    if trouble.kind == "fix":
        return f"{trouble.reason}; modbus-gateway check says why"
    if trouble.page != "units" or not trouble.requests:
        return f"{trouble.kind}: {trouble.reason}"
    lost = f"{trouble.share:.0%} of {trouble.requests} requests without an answer in the last minutes"
    return f"{lost}; last was {trouble.reason}" if trouble.reason else lost


def _paragraphs(about: list[Note], width: int) -> Iterator[str]:
    for note in about:
        yield from wrapped(str(note), width, _INDENT, 2 * _INDENT)
