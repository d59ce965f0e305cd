"""Turns pages in Markdown into manual pages: as much of Markdown as our generated pages use."""

import re
from collections.abc import Iterator
from typing import Final

#: A paragraph that wants to be set another way, by what its first line begins with.
_TABLE, _FENCE, _CODE, _ITEM = "|", "```", "    ", re.compile(r"(?:-|\d+\.) ")
_BULLET: Final = "\\(bu"
_HEADINGS: Final = {"#": ".SH", "##": ".SH", "###": ".SS", "####": ".SS"}
_INLINE: Final = re.compile(
    r"`(?P<code>[^`]+)`|\*\*(?P<bold>[^*]+)\*\*|\*(?P<italic>[^*\s][^*]*)\*"
    r"|\[(?P<label>(?:`[^`]*`|[^\]`])+)\]\((?P<address>[^)]+)\)"
)


def manual_page(name: str, section: int, manual: str, markdown: str) -> str:
    """Write the page `name(section)` of the `manual` with this text, whose first heading is NAME."""
    text = re.sub(r"<!--.*?-->\n*", "", markdown, flags=re.DOTALL)
    head = f'.TH "{name.upper()}" "{section}" "" "modbus-gateway" "{manual}"\n.ad l'
    return "\n".join([head.replace("-", "\\-"), *_blocks(text.splitlines())]) + "\n"


def _blocks(lines: list[str]) -> Iterator[str]:
    at = 0
    while at < len(lines):
        begin, first = at, lines[at]
        at += 1
        if not first.strip():
            continue
        if first.startswith(_FENCE):
            at = lines.index(_FENCE, at) + 1
            yield from _verbatim(lines[begin + 1 : at - 1])
            continue
        while at < len(lines) and lines[at].strip() and not first.startswith("#"):
            at += 1
        yield from _block(lines[begin:at])


def _block(lines: list[str]) -> Iterator[str]:
    """Set lines that belong together."""
    marks, _, heading = lines[0].partition(" ")
    if marks in _HEADINGS:
        yield f"{_HEADINGS[marks]} {_set(heading if len(marks) > 2 else heading.upper())}"
    elif lines[0].startswith(_TABLE):
        yield from _rows(lines)
    elif lines[0].startswith(_CODE):
        yield from _verbatim([line.removeprefix(_CODE) for line in lines])
    elif _ITEM.match(lines[0]):
        items = re.split(r"\n(?=(?:-|\d+\.) )", "\n".join(lines))
        for item in items:
            mark, text = item.split(" ", 1)
            yield f".IP {_BULLET if mark == '-' else mark} 4\n{_set(' '.join(text.split()))}"
    else:
        yield f".PP\n{_set(' '.join(lines))}"


def _rows(lines: list[str]) -> Iterator[str]:
    """Set a table as a list: the first column is what is explained, the last one says what it is."""
    head, _, *rows = lines
    names = _cells(head)
    for row in rows:
        first, *between, last = _cells(row)
        told = (
            f"{name} {cell}" if name == "default" and not cell.startswith("**") else cell
            for name, cell in zip(names[1:-1], between, strict=True)
            if cell
        )
        yield f".TP\n{_set('; '.join([first, *told]))}\n{_set(last)}"


def _cells(row: str) -> list[str]:
    return [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", row.strip().strip("|"))]


def _verbatim(lines: list[str]) -> Iterator[str]:
    yield "\n".join([".PP", ".RS 4", ".EX", *(_escaped(line) for line in lines), ".EE", ".RE"])


def _set(text: str) -> str:
    """Set a text with code and links in it: code is bold, and of a link to a page of ours only its text stays."""
    parts, at = [], 0
    for found in _INLINE.finditer(text):
        parts += [_plain(text[at : found.start()]), _marked(**found.groupdict())]
        at = found.end()
    return _protected("".join([*parts, _plain(text[at:])]))


def _marked(code: str | None, bold: str | None, italic: str | None, label: str | None, address: str | None) -> str:
    if code:
        return f"\\fB{' '.join(_unbroken(word) for word in code.split(' '))}\\fR"
    if label is None:
        return f"\\fB{_plain(bold)}\\fR" if bold else f"\\fI{_plain(italic or '')}\\fR"
    return f"{_set(label)} ({_unbroken(address)})" if address and address.startswith("http") else _set(label)


def _unbroken(word: str) -> str:
    """Set a word that is never hyphenated."""
    return f"\\%{_plain(word)}"


def _escaped(line: str) -> str:
    return _protected(_plain(line))


def _plain(text: str) -> str:
    return text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq")


def _protected(line: str) -> str:
    """Let no line begin as a request of roff."""
    return f"\\&{line}" if line.startswith((".", "'")) else line
