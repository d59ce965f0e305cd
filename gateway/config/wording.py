"""What pydantic and tomllib find, in words for people who edit the file."""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, get_args

from pydantic import PlainValidator, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from gateway.config.masking import is_secret
from gateway.config.problem import NotText, Path, Problem, WrongValue, did_you_mean, error
from gateway.config.table import Table
from gateway.config.toml_text import value_text

#: A key and a value without quotes, in a line that is not TOML.
_BARE_VALUE = re.compile(r"([\w.-]+)[ \t]*=[ \t]*([^\s\"'\[{,}#][^,}\]#\"']*)")

#: A key and a value with a colon between them, as YAML and JSON have it; a key and one word with only a space.
_COLON = re.compile(r"\s*([\w.-]+)(?:\s*:|(?=\s+(?:[^=\s]+|\"[^\"]*\")\s*$))\s*(.+?)\s*")

#: What begins the next statement, where a list has not ended: a table or a key.
_STATEMENT = re.compile(r"\[|[\w.-]+\s*=")

#: How comments begin elsewhere.
_COMMENTS_ELSEWHERE = ("//", ";", "/*", "--")

_NO_COMMA = "a comma is missing before this"

#: Rates below this are meant in 1000 bits per second.
_MOST_KILOBAUD = 1000

#: How tomllib says that text does not end where it should.
_NO_CLOSING_QUOTE = ("Illegal character '\\n'", "Found invalid character '\\n'", "Unterminated string", 'Expected "\'"')

#: Quotes that TOML does not know.
_TYPOGRAPHIC_QUOTES = "\u201c\u201d\u201e\u201f\u2018\u2019\u201a\u00ab\u00bb"

_WHOLE_NUMBER = re.compile(r"[0-9]+")
_NUMBER = re.compile(r"[0-9]+(\.[0-9]+)?")

_SYNTAX_ERROR = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.DOTALL)
_DECLARED_TWICE = re.compile(r"Cannot declare \('([^']+)',\) twice")

#: What other programs call a key, and the keys it may be here, in lower case; the first that the table has is meant.
_ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("parity", "stopbits", "stop_bits", "bytesize", "databits", "data_bits"), ("format",)),
    **dict.fromkeys(("speed", "baudrate", "baud_rate"), ("baud",)),
    **dict.fromkeys(("slave", "slave_id", "slaveid", "unit_id", "id"), ("unit",)),
    **dict.fromkeys(("protocol", "type"), ("mode",)),
    **dict.fromkeys(("units", "slaves"), ("devices",)),
    "address": ("unit", "bind", "to"),
}

#: What a point's place is called elsewhere, in lower case.
_PLACES = frozenset({"register", "reg", "address", "addr", "offset"})

#: What is written for a value elsewhere, and here.
_VALUES_ELSEWHERE: Mapping[str, str] = {
    **dict.fromkeys(("real", "float"), "float32"),
    "double": "float64",
    **dict.fromkeys(("word", "true"), "words"),
    "slave": "server",
    "master": "client",
}

#: What is true or false elsewhere, in lower case.
_TRUTHS: Mapping[str, str] = {
    **dict.fromkeys(("true", "yes", "on"), "true"),
    **dict.fromkeys(("false", "no", "off"), "false"),
}

_TYPES: Mapping[str, str] = {
    "int_type": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false, without quotes",
    "tuple_type": "must be a list",
    "model_type": "must be a table",
    "missing": "{key} is missing",
}

_LIMITS: Mapping[str, str] = {
    "greater_than_equal": "must be at least {ge:.12g}",
    "greater_than": "must be more than {gt:.12g}",
    "less_than_equal": "must be at most {le:.12g}",
}


def value_problems(
    found: ValidationError, model: type[Table], path: Path, written: Callable[[Path], str]
) -> Iterator[Problem]:
    """What is wrong in the table at `path`, which should be a `model`.

    `written` gives the text of a value as it stands in the file.
    """
    for one in found.errors(include_url=False):
        yield _value_problem(one, model, path, written)


def unknown_key(path: Path, known: list[str]) -> Problem:
    """The key at the end of `path` is none of the `known` ones."""
    written = str(path[-1])
    meant = next((key for key in _ELSEWHERE.get(written.lower(), ()) if key in known), None)
    if written.lower() in _PLACES and {"holding", "labels"} <= set(known):
        remedy = "a point has an area: holding = 10 (or input, coils, discrete), counted from 0"
    elif meant == "format":
        remedy = 'it is part of format, such as format = "8E1": data bits, parity, stop bits'
    elif written == "site":
        remedy = "site stands at the top of the file, before the first [table]"
    else:
        remedy = did_you_mean(written, known) if meant is None else f'did you mean "{meant}"?'
    return Problem("error", path, "unknown key", remedy, on_key=True)


def not_text(path: Path, value: object, written: Callable[[Path], str]) -> Problem:
    """The value at `path` must be text: if it is a number, a date or a word, it lacks its quotes."""
    is_scalar = not isinstance(value, (list, dict))
    if path[-1] == "of" and isinstance(value, int):
        return error(path, "must be text", "write the name of the device in quotes, not its number")
    shown = "..." if is_secret(_dotted(path)) else written(path)
    return error(path, "must be text", f'put it in quotes: "{shown}"' if is_scalar else "")


def _dotted(path: Path) -> str:
    return ".".join(map(str, path))


def syntax_problem(found: ValueError, text: str) -> Problem:
    """Where and why `text` is no TOML."""
    match = _SYNTAX_ERROR.fullmatch(str(found))
    if match is None:
        return error((), str(found))
    lines = text.split("\n")
    line, column = (int(match[2]), int(match[3])) if match[2] else (len(lines), len(lines[-1]) + 1)
    return _explain(match[1], lines[line - 1], column).located("", line, column)


def keys_of(model: type[Table]) -> list[str]:
    """The keys of a table, as a user writes them."""
    return [field.alias or name for name, field in model.model_fields.items()]


def row_model(annotation: Any) -> type[Table] | None:
    """The table inside a type such as `tuple[Device, ...] | None`, if there is one."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((model for part in get_args(annotation) if (model := row_model(part))), None)


def _value_problem(found: ErrorDetails, model: type[Table], base: Path, written: Callable[[Path], str]) -> Problem:
    kind, loc, context = found["type"], found["loc"], found.get("ctx", {})
    path = base + loc
    wrong = context.get("error")
    if kind == "extra_forbidden":
        return unknown_key(path, keys_of(_model_at(model, loc[:-1])))
    if kind == "string_type" or isinstance(wrong, NotText):
        return not_text(path, found["input"], written)
    if isinstance(wrong, WrongValue):
        return error(path, str(wrong), wrong.remedy)
    if kind == "literal_error":
        choices = str(context["expected"]).replace("'", '"')
        written_ = str(found["input"]).lower()
        elsewhere = f'"{_VALUES_ELSEWHERE.get(written_, written_)}"'
        meant = elsewhere if elsewhere in choices else f'"{written_}"'
        return error(path, f"must be {choices}", f"did you mean {meant}?" if meant in choices else "")
    if kind in _LIMITS:
        return error(path, _LIMITS[kind].format(**context))
    what = _TYPES.get(kind, "cannot be used: {reason}")
    return error(path, what.format(key=path[-1], reason=found["msg"]), _right_type(kind, path, found["input"]))


def _right_type(kind: str, path: Path, value: object) -> str:
    """How to write a value of the wrong type, if that can be told."""
    key = path[-1]
    number = {"int_type": _WHOLE_NUMBER, "float_type": _NUMBER}.get(kind)
    if number is not None and isinstance(value, str) and number.fullmatch(value):
        return f"write it without quotes: {key} = {value}"
    if key == "baud":
        return _right_rate(value)
    if kind == "bool_type" and isinstance(value, str):
        return _write_truth(str(key), value)
    if kind == "tuple_type" and isinstance(value, dict):
        return f"put it in brackets: {key} = [{{ ... }}]"
    if kind == "tuple_type" and isinstance(value, str) and not is_secret(_dotted(path)):
        return f"put it in brackets: {key} = [{value_text(value)}]"
    return ""


def _right_rate(value: Any) -> str:
    if value == "auto":
        return "modbus-gateway scan --port PORT --all-speeds finds the rate of a line"
    is_kilobaud = isinstance(value, float) and 0 < value < _MOST_KILOBAUD
    return f"in bits per second: baud = {1000 * value:.0f}" if is_kilobaud else ""


def _model_at(model: type[Table], loc: Path) -> type[Table]:
    """The table that stands at `loc` inside a table of this model."""
    for part in loc:
        if isinstance(part, str):
            fields = {field.alias or name: field for name, field in model.model_fields.items()}
            model = row_model(fields[part].annotation) or model
    return model


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
    """What is wrong with a list or a table in { }, of which the `rest` of the line cannot be read."""
    is_at_end = not rest or rest.startswith("#")
    if is_at_end and what.startswith(("Invalid initial character for a key part", "Unclosed inline table")):
        return "a table in { } must be on one line; a long one of devices may be [[line.devices]], a key on each line"
    if what.startswith("Unclosed array") and _STATEMENT.match(rest):
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
    """How to write a value that is no TOML. A text editor may have put other quotes around it."""
    value = written.strip(_TYPOGRAPHIC_QUOTES)
    if key in _keys(_is_number):
        return f"{key} is a number: digits only, not {written}"
    if key in _keys(_is_truth):
        return _write_truth(key, value)
    what = "put the value in quotes" if value == written else "put the value in straight quotes"
    return f'{what}: {key} = "{"..." if is_secret(key) else value}"'


def _keys(is_so: Callable[[FieldInfo], bool]) -> set[str]:
    """The keys that are so in every table that has them."""
    fields = [field for model in Table.__subclasses__() for field in model.model_fields.items()]
    keys = [(field.alias or name, is_so(field)) for name, field in fields]
    return {key for key, it_is in keys if it_is} - {key for key, it_is in keys if not it_is}


def _is_truth(field: FieldInfo) -> bool:
    return field.annotation is bool


def _write_truth(key: str, written: str) -> str:
    """How to write what is true or false elsewhere."""
    value = _TRUTHS.get(written.lower())
    return f"write {key} = {value}" if value else f"write {key} = true, or false"


def _is_number(field: FieldInfo) -> bool:
    """Whether it is written as a number: a duration is read from text."""
    is_read_from_text = any(isinstance(each, PlainValidator) for each in field.metadata)
    return field.annotation in (int, float) and not is_read_from_text


def _is_toml(value: str) -> bool:
    try:
        tomllib.loads(f"key = {value}")
    except tomllib.TOMLDecodeError:
        return False
    return True
