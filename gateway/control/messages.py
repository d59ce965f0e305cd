"""The JSON objects of the control socket: the question and the answers of an operation."""

import json
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any, Final, TypeVar

from gateway.operator.operations.json_text import json_text
from gateway.operator.operations.operation import Operation
from gateway.operator.operations.parameters import fields_of
from gateway.operator.operations.results import NotUnderstoodError, read_result

P = TypeVar("P")
R = TypeVar("R")

#: Follows the last of several answers.
END: Final[Mapping[str, Any]] = {"end": True}


def _plain(value: object) -> dict[str, Any] | str:
    return fields_of(value) if is_dataclass(value) else str(value)


#: Writes a message as JSON, in which dataclasses are objects too.
WRITE: Final = json.JSONEncoder(default=_plain).encode


def line_of(message: Mapping[str, Any]) -> bytes:
    """Encode a message as one line."""
    return json_text(message, WRITE) + b"\n"


def question_of(operation: Operation[P, R], asked: P) -> dict[str, Any]:
    """Make the question of an operation. None is left out: an earlier version may not know the parameter."""
    return {"verb": operation.name, **{name: value for name, value in fields_of(asked).items() if value is not None}}


def answer_of(operation: Operation[P, R], result: R) -> Mapping[str, Any]:
    """Make an answer of an operation. If it has several, None is left out."""
    if operation.key:
        return {operation.key: result}
    told = fields_of(result)
    return {name: each for name, each in told.items() if each is not None} if operation.is_repeated else told


def result_in(operation: Operation[P, R], answer: Mapping[str, Any]) -> R:
    """Read the result from an answer.

    Raises:
        NotUnderstoodError: it is not there, or has another form.
    """
    if not operation.key:
        return read_result(operation.result, answer)
    if operation.key not in answer:
        raise NotUnderstoodError("is missing", operation.key)
    try:
        return read_result(operation.result, answer[operation.key])
    except NotUnderstoodError as wrong:
        raise wrong.inside(operation.key) from None
