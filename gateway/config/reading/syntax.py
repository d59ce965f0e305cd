"""What is wrong with text that is no TOML, in words for people who edit the file."""

import re
import tomllib
from collections.abc import Callable, Container, Mapping
from typing import Any, Final

from pydantic.fields import FieldInfo

from gateway.config.problem import Problem, error
from gateway.config.reading.masking import is_secret
from gateway.config.reading.positions import STRING, Positions
from gateway.config.reading.toml_text import value_text
from gateway.config.schema.table import Table
from gateway.config.values.kind import Kind

NESTED: Final = error((), "is nested too deeply")
#: A key and a value without quotes, in a line that is not TOML.
_BARE_VALUE = re.compile(r"([\w.-]+)[ \t]*=[ \t]*([^\s\"'\[{,}#][^,}\]#\"']*)")

#: A key and a value with a colon between them, as YAML and JSON have it; a key and one word with only a space.
_COLON = re.compile(r"\s*([\w.-]+)(?:\s*:|(?=\s+(?:[^=\s]+|\"[^\"]*\")\s*$))\s*(.+?)\s*")

#: What begins the next statement, where a list has not ended: the header of a table or a key.
_STATEMENT = re.compile(r"\[\[?\s*[A-Za-z_\"']|[\w.-]+\s*=")

#: The header of a table, perhaps with other brackets at its end than at its begin.
_HEADER = re.compile(r"\s*(\[{1,2})\s*([A-Za-z_][\w.-]*)\s*(\]{0,2})\s*(?:#.*)?")

#: What matters for where a list ends: strings and comments may have brackets too.
_TOKEN = re.compile(rf"(?:{STRING.pattern})|#[^\n]*|[\[\]{{}}]", re.DOTALL)

#: How comments begin elsewhere.
_COMMENTS_ELSEWHERE = ("//", ";", "/*", "--")

_NO_COMMA = "a comma is missing before this"

#: How tomllib says that text does not end where it should.
_NO_CLOSING_QUOTE = ("Illegal character '\\n'", "Found invalid character '\\n'", "Unterminated string", 'Expected "\'"')

#: Quotes that TOML does not know.
_TYPOGRAPHIC_QUOTES = "\u201c\u201d\u201e\u201f\u2018\u2019\u201a\u00ab\u00bb"

#: What is true or false elsewhere, in lower case.
_TRUTHS: Mapping[str, str] = {
    **dict.fromkeys(("true", "yes", "on"), "true"),
    **dict.fromkeys(("false", "no", "off"), "false"),
}

_SYNTAX_ERROR = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.DOTALL)
_DECLARED_TWICE = re.compile(r"Cannot declare \('([^']+)',\) twice")


def read_document(text: str, file: str, lists: Container[str] = ()) -> tuple[dict[str, Any], Positions] | Problem:
    """Parse a text, the content of `file`, into its tables and their places; or say where and why it is no TOML."""
    try:
        return tomllib.loads(text), Positions(text)
    except ValueError as wrong:  # mostly a TOMLDecodeError; a number of 5000 digits is not
        problem = syntax_problem(wrong, text, lists)
        return problem.located(file, problem.line, problem.column)
    except RecursionError:
        return NESTED.located(file, 1, 1)


def syntax_problem(found: ValueError, text: str, lists: Container[str]) -> Problem:
    """Say where and why `text` is no TOML. Of the tables in `lists` there may be several."""
    match = _SYNTAX_ERROR.fullmatch(str(found))
    if match is None:
        return error((), str(found))
    lines = text.split("\n")
    line, column = (int(match[2]), int(match[3])) if match[2] else (len(lines), len(lines[-1]) + 1)
    before = "\n".join(lines if match[2] is None else lines[: line - 1])
    is_statement = match[2] is None or _STATEMENT.match(lines[line - 1].strip())
    return (
        _about_header(match[1], lines, line, lists)
        or (_about_list(before) if is_statement and not match[1].startswith(_NO_CLOSING_QUOTE) else None)
        or _explain(match[1], lines[line - 1], column).located("", line, column)
    )


def _about_header(what: str, lines: list[str], line: int, lists: Container[str]) -> Problem | None:
    """Explain what is wrong with the brackets of a header: of this line, or of an earlier one for the same table."""
    header = _HEADER.fullmatch(lines[line - 1])
    if header is None:
        return None
    opening, name, closing = header.groups()
    if len(opening) != len(closing):
        brackets = 2 if name in lists else len(opening) if "." in name else 1
        remedy = f"write {'[' * brackets}{name}{']' * brackets}"
        return error((), "brackets are missing in this header, or too many", remedy).located("", line, 1)
    if what == "Cannot overwrite a value":
        for number, each in enumerate(lines[: line - 1], 1):
            first = _HEADER.fullmatch(each)
            if first is not None and first[2] == name:
                said = f"[{name}] is one table, but line {line} has [[{name}]], one of several"
                return error((), said, f"write [[{name}]] here too").located("", number, 1)
    return None


def _about_list(before: str) -> Problem | None:
    """Find a list that has not ended in what stands `before` a new statement, or the end."""
    begin = _unclosed_list(before)
    if begin is None:
        return None
    line, column = before.count("\n", 0, begin) + 1, begin - before.rfind("\n", 0, begin)
    return error((), "the list that begins here has no ] at its end").located("", line, column)


def _unclosed_list(text: str) -> int | None:
    """Find where the list begins that has not ended at the end of `text`, if there is one."""
    opened: list[int] = []
    at = 0
    while (match := _TOKEN.search(text, at)) is not None:
        at = match.end()
        if match[0] in "[{":
            if not opened and not text[text.rfind("\n", 0, match.start()) + 1 : match.start()].strip():  # a header
                at = max(at, text.find("\n", at))
            else:
                opened.append(match.start())
        elif match[0] in "]}" and opened:
            opened.pop()
    return opened[-1] if opened and text[opened[-1]] == "[" else None


def _explain(what: str, line: str, column: int) -> Problem:
    twice = _DECLARED_TWICE.match(what)
    if twice is not None:
        return error((), f"[{twice[1]}] is there twice", f"write [[{twice[1]}]] if there are several")
    if what == "Cannot overwrite a value":
        return error((), "this key is there twice")
    if what.startswith(_NO_CLOSING_QUOTE):
        return error((), "the text has no closing quote", "put the quote that it begins with at its end too")
    colon = _COLON.fullmatch(line)
    if colon is not None and what.startswith("Expected '='"):
        value = colon[2].rstrip(",")
        shown = '"..."' if is_secret(colon[1]) else value if _is_toml(value) else value_text(value)
        return error((), "a key and its value have = between them", f"write {colon[1]} = {shown}")
    rest = line[column - 1 :].strip()
    if rest.startswith(_COMMENTS_ELSEWHERE):
        return error((), what[:1].lower() + what[1:], "comments begin with #")
    is_next_key = what.startswith("Unclosed inline table") and _STATEMENT.match(rest)
    remedy = _NO_COMMA if is_next_key else _missing_quotes(line) or _how_to_go_on(what, rest)
    return error((), what[:1].lower() + what[1:], remedy)


def _how_to_go_on(what: str, rest: str) -> str:
    """Say what is wrong with a list or a table in { }, of which the `rest` of the line cannot be read."""
    is_at_end = not rest or rest.startswith("#")
    if is_at_end and what.startswith(("Invalid initial character for a key part", "Unclosed inline table")):
        return "a table in { } is on one line; a long one: [[line.devices]], [[profile.NAME.points]], a key a line"
    if what.startswith("Unclosed array") and rest.startswith("}"):
        return "the list before this has no ] at its end"
    if not is_at_end and what.startswith(("Unclosed array", "Unclosed inline table")):
        return _NO_COMMA
    return ""


def _missing_quotes(line: str) -> str:
    for key, value in _BARE_VALUE.findall(line.partition("#")[0]):
        if not _is_toml(value):
            return _as_toml(key, value.strip())
    return ""


def _as_toml(key: str, written: str) -> str:
    """Say how to write a value that is no TOML. A text editor may have put other quotes around it."""
    value = written.strip(_TYPOGRAPHIC_QUOTES)
    if key in _keys(_is_number):
        return f"{key} is a number: digits only, not {written}"
    if key in _keys(_is_truth):
        return write_truth(key, value)
    what = "put the value in quotes" if value == written else "put the value in straight quotes"
    return f'{what}: {key} = "{"..." if is_secret(key) else value}"'


def _keys(is_so: Callable[[FieldInfo], bool]) -> set[str]:
    """Find the keys that are so in every table that has them."""
    fields = [field for model in Table.__subclasses__() for field in model.model_fields.items()]
    keys = [(field.alias or name, is_so(field)) for name, field in fields]
    return {key for key, it_is in keys if it_is} - {key for key, it_is in keys if not it_is}


def _is_truth(field: FieldInfo) -> bool:
    return field.annotation is bool


def write_truth(key: str, written: str) -> str:
    """Say how to write what is true or false elsewhere."""
    value = _TRUTHS.get(written.lower())
    return f"write {key} = {value}" if value else f"write {key} = true, or false"


def _is_number(field: FieldInfo) -> bool:
    """Tell whether a value is written as a number: a duration is read from text."""
    is_read_from_text = any(isinstance(each, Kind) and each.parse is not None for each in field.metadata)
    return field.annotation in (int, float) and not is_read_from_text


def _is_toml(value: str) -> bool:
    try:
        tomllib.loads(f"key = {value}")
    except tomllib.TOMLDecodeError:
        return False
    return True
