"""What pydantic and tomllib find, in words for people who edit the file."""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from gateway.config.problem import NotText, Path, Problem, WrongValue, did_you_mean, error
from gateway.config.reading.masking import is_secret
from gateway.config.reading.syntax import write_truth
from gateway.config.reading.toml_text import value_text
from gateway.config.schema.line import Line
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.table import Table, keys_of, row_model
from gateway.config.schema.upstream import Upstream

#: Rates below this are meant in 1000 bits per second.
_MOST_KILOBAUD = 1000

_WHOLE_NUMBER = re.compile(r"[0-9]+")
_NUMBER = re.compile(r"[0-9]+(\.[0-9]+)?")

#: What other programs call a key, and the keys it may be here, in lower case; the first that the table has is meant.
_ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("parity", "stopbits", "stop_bits", "bytesize", "databits", "data_bits"), ("format",)),
    **dict.fromkeys(("speed", "baudrate", "baud_rate"), ("baud",)),
    **dict.fromkeys(("slave", "slave_id", "slaveid", "unit_id", "id"), ("unit",)),
    **dict.fromkeys(("protocol", "type"), ("mode",)),
    **dict.fromkeys(("units", "devices", "slaves"), ("devices", "units")),
    **dict.fromkeys(("to", "port", "host", "url"), ("to", "port", "bind")),
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
    """Say what is wrong in the table at `path`, which should be a `model`.

    `written` gives the text of a value as it stands in the file.
    """
    for one in found.errors(include_url=False):
        yield _value_problem(one, model, path, written)


def unknown_key(path: Path, known: list[str]) -> Problem:
    """Say that the key at the end of `path` is none of the `known` ones, and which may be meant."""
    written = str(path[-1])
    meant = next((key for key in _ELSEWHERE.get(written.lower(), ()) if key in known), None)
    if written.lower() in _PLACES and {"holding", "labels"} <= set(known):
        remedy = "a point has an area: holding = 10 (or input, coils, discrete), counted from 0"
    elif meant == "format":
        remedy = 'it is part of format, such as format = "8E1": data bits, parity, stop bits'
    elif written == "include" or (written == "site" and "sites" not in known):
        remedy = f"{written} stands at the top of the file, before the first [table]"
    else:
        remedy = _where_it_is(path) or did_you_mean(written, known) if meant is None else f'did you mean "{meant}"?'
    return Problem("error", path, "unknown key", remedy, on_key=True)


def _where_it_is(path: Path) -> str:
    """Say in which table a key stands that a line, another server or a device does not have."""
    tables = (("[[line]]", Line), ("[[upstream]]", Upstream), ("[profile.NAME]", ProfileTable))
    found = [name for name, table in tables if path[-1] in keys_of(table)] if path[0] in ("line", "upstream") else []
    return f"it is a key of {' and '.join(found)}" if found else ""


def not_text(path: Path, value: object, written: Callable[[Path], str]) -> Problem:
    """Say that the value at `path` must be text: if it is a number, a date or a word, it lacks its quotes."""
    is_scalar = not isinstance(value, (list, dict))
    if path[-1] in ("of", "age") and isinstance(value, int):
        return error(path, "must be text", "write the name of the device in quotes, not its number")
    shown = "..." if is_secret(_dotted(path)) else written(path)
    return error(path, "must be text", f'put it in quotes: "{shown}"' if is_scalar else "")


def _dotted(path: Path) -> str:
    return ".".join(map(str, path))


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
    """Say how to write a value of the wrong type; empty if that cannot be told."""
    key = path[-1]
    number = {"int_type": _WHOLE_NUMBER, "float_type": _NUMBER}.get(kind)
    if number is not None and isinstance(value, str) and number.fullmatch(value):
        return f"write it without quotes: {key} = {value}"
    if key == "baud":
        return _right_rate(value)
    if kind == "bool_type" and isinstance(value, str):
        return write_truth(str(key), value)
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
    """Find the table that stands at `loc` inside a table of this model."""
    for part in loc:
        if isinstance(part, str):
            fields = {field.alias or name: field for name, field in model.model_fields.items()}
            model = row_model(fields[part].annotation) or model
    return model
