"""Makes the document of the API, OpenAPI 3.1, from the table of operations; the gateway serves it as it was made.

    .venv/bin/python -m deploy.api_document > gateway/web/api/openapi.json

The schemas are those that pydantic makes of the types of operations. A running gateway does not load it.
"""

import json
import sys
from collections.abc import Collection, Mapping
from typing import Any, Final, get_type_hints

from deploy.api_schemas import PLACE, Schema, reference_to, schema_of, schemas_of, without_null
from gateway.errors import ExceptionReceived, WrongQuestion
from gateway.operator.operations.answers.running import Reloaded
from gateway.operator.operations.answers.status import (
    ImageStatus,
    LineStatus,
    MirrorStatus,
    MonitorStatus,
    ServerStatus,
    UnknownUnitStatus,
    UpstreamStatus,
    VirtualStatus,
)
from gateway.operator.operations.answers.unit import UnitHead
from gateway.operator.operations.asked import PointsToWrite, PointToWrite, ToSupport, ValuesToWrite
from gateway.operator.operations.operation import Operation
from gateway.operator.operations.parameters import Parameter, parameters_of
from gateway.operator.operations.table import OPERATIONS
from gateway.web.api.operations import NAMED, ROOT, Operations
from gateway.web.api.session import Session
from gateway.web.api.trace import RecordsToCapture, RecordsToFollow
from gateway.web.front.problems import OF_EXCEPTIONS, STATUSES, Problem

#: Types that have a shorter name here than in the program.
_NAMES: Final[Mapping[type, str]] = {
    LineStatus: "Line",
    ServerStatus: "Server",
    UpstreamStatus: "Upstream",
    ImageStatus: "Image",
    MirrorStatus: "Mirror",
    MonitorStatus: "Monitor",
    UnknownUnitStatus: "UnknownUnit",
    VirtualStatus: "VirtualUnit",
    UnitHead: "Unit",
    Reloaded: "Reload",
}
#: The names of shared bodies, by the types of parameters; other bodies are described where they are used.
_BODIES: Final[Mapping[type, str]] = {
    ValuesToWrite: "NewValues",
    PointToWrite: "NewValues",
    PointsToWrite: "NamedValues",
}
_DESCRIPTION: Final = "State of the gateway, and values of its units. Addresses are protocol addresses from 0."
_WHATS: Final = {
    400: "Invalid request",
    401: "A login, or a token, is needed; or the token is wrong",
    403: "Not allowed; `exception` 1: by [[access]], or the unit has no such function",
    404: "There is no such unit, line or point",
    408: "The body took too long",
    409: "A reload has led this unit's number elsewhere meanwhile: ask again",
    411: "The body has no Content-Length",
    413: "The body is too large",
    415: "The body is not JSON",
    422: "`exception` 2 or 3 of the unit, or a value that does not fit; of a reload: the file was rejected",
    429: "Many wrong tokens came from this address: try again after `Retry-After` seconds",
    502: "`exception` 10: the unit cannot be reached; or another exception of the unit",
    503: "`exception` 6: the line is too busy; or too many readers, or the gateway is not ready",
    504: "`exception` 11: no valid response within the time limit",
}
_OF_ALL: Final = frozenset({401, 403, 429})
_OF_CHANGES: Final = frozenset({408, 411, 413, 415})
_OF_STREAMS: Final = frozenset({400, 404, 503})
_CSRF: Final = {
    "name": "X-CSRF-Token",
    "in": "header",
    "required": False,
    "schema": {"type": "string"},
    "description": "With the cookie of a login it must be that of the session",
}
_OF_OPERATORS: Final = (
    "Needs a token with the role operator; or the cookie of a login, X-CSRF-Token, and an Origin with the name that "
    "the gateway is called by."
)
_TOKENS: Final = (
    "That of the config (`token` in `[web]`), which reads; or one with a role (`modbus-gateway user NAME --token`)"
)
_CHANGING: Final[list[dict[str, list[str]]]] = [{"token": []}, {"session": []}]


def document(operations: Operations = OPERATIONS) -> dict[str, Any]:
    """Make the document. The server fills in its version, and the name of its cookie."""
    listed = [each for each in operations if each.path is not None]
    return _renamed(
        {
            "openapi": "3.1.0",
            "info": {
                "title": "modbus-gateway",
                "version": "",
                "description": _DESCRIPTION,
            },
            "paths": _paths(listed) | _other_paths(),
            "components": {
                "schemas": _components(listed),
                "securitySchemes": {
                    "token": {"type": "http", "scheme": "bearer", "description": _TOKENS},
                    "session": {"type": "apiKey", "in": "cookie", "name": ""},
                },
            },
            "security": [{}, {"token": []}, {"session": []}],
        }
    )


def as_text(document: Mapping[str, Any]) -> str:
    """Write the document as it is stored."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _renamed(document: dict[str, Any]) -> dict[str, Any]:
    """Give types their shorter names."""
    schemas, names = document["components"]["schemas"], {kind.__name__: name for kind, name in _NAMES.items()}
    document["components"]["schemas"] = {names.get(name, name): schema for name, schema in schemas.items()}
    text = json.dumps(document)
    for long, short in names.items():
        text = text.replace(f'"{PLACE}{long}"', f'"{PLACE}{short}"')
    renamed: dict[str, Any] = json.loads(text)
    return renamed


def _paths(operations: Operations) -> dict[str, Any]:
    paths: dict[str, Any] = {}
    for each in operations:
        paths.setdefault(f"{ROOT}{each.path}", {})[each.method.lower()] = _operation(each)
    return paths


def _operation(operation: Operation[Any, Any]) -> dict[str, Any]:
    in_path = set(NAMED.findall(operation.path or ""))
    known = parameters_of(operation.parameters)
    told: dict[str, Any] = {"summary": operation.summary, "operationId": operation.name}
    parameters = [
        _parameter(each, operation.parameters, is_in_path=each.name in in_path) for each in known if not each.is_in_body
    ]
    statuses = {*_OF_ALL, *(status for kind in operation.refuses for status in _statuses(kind))}
    if any(each.name not in in_path or str not in each.types for each in known):
        statuses.add(400)
    if operation.right != "reading":
        condition = ", if `write` is set" if operation.right == "writing" else ""
        told["description"] = f"For operators{condition}. {_OF_OPERATORS}"
        told["security"] = _CHANGING
        parameters.append(_CSRF)
        statuses |= _OF_CHANGES
    if any(each.is_in_body for each in known):
        told["requestBody"] = _in_json(_body(operation.parameters)) | {"required": True}
    if parameters:
        told["parameters"] = parameters
    return {**told, "responses": {"200": _ok(schema_of(operation.result)), **_problems(statuses)}}


def _statuses(kind: type[WrongQuestion]) -> set[int]:
    if issubclass(kind, ExceptionReceived):
        return {*OF_EXCEPTIONS.values(), 502}
    return {STATUSES[kind]}


def _parameter(parameter: Parameter, kind: type[Any], *, is_in_path: bool) -> dict[str, Any]:
    schema = without_null(schema_of(get_type_hints(kind, include_extras=True)[parameter.name]))
    if not is_in_path and not parameter.is_required and parameter.default not in (None, ""):
        schema["default"] = parameter.default
    place = {"in": "path", "required": True} if is_in_path else {"in": "query", "required": parameter.is_required}
    return {"name": parameter.name, **place, "schema": schema, "description": parameter.what}


def _body(kind: type[Any]) -> Schema:
    return reference_to(_BODIES[kind]) if kind in _BODIES else _body_schema(kind)


def _body_schema(kind: type[Any]) -> Schema:
    return {
        "type": "object",
        "properties": {name: schema_of(each) for name, each in _types_in_body(kind).items()},
        "required": [each.name for each in parameters_of(kind) if each.is_in_body and each.is_required],
        "additionalProperties": False,
    }


def _types_in_body(kind: type[Any]) -> dict[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {each.name: hints[each.name] for each in parameters_of(kind) if each.is_in_body}


def _other_paths() -> dict[str, Any]:
    """Describe what only HTTP can do."""
    record = (
        "On each `data:` line a record in JSON, as `modbus-gateway trace --json` prints it; what the reader may not "
        'read is null. Also each second `{"kind": "clock"}` with the `time`, and `{"kind": "missed"}` with the `count` '
        "of records that were gone before they could be sent"
    )
    return {
        f"{ROOT}/openapi.json": {"get": _get("This document", _ok({"type": "object"}))},
        f"{ROOT}/session": {
            "get": _get("Who has logged in, and the token for X-CSRF-Token", _ok(schema_of(Session))),
        },
        f"{ROOT}/events": {
            "get": _get("Events as they come", _stream("An event in JSON on each `data:` line"), {503}),
        },
        f"{ROOT}/trace": {
            "parameters": _in_query(RecordsToFollow),
            "get": _get("What happens on the lines, as it happens", _stream(record), _OF_STREAMS),
        },
        f"{ROOT}/support": {
            "parameters": _in_query(ToSupport),
            "post": {
                **_get(
                    "A diagnostics bundle: config without secrets, status, findings, trace, versions",
                    {"description": "A .tar.gz file", "content": {"application/gzip": {}}},
                    {400, 503, *_OF_CHANGES},
                ),
                "description": f"For operators. {_OF_OPERATORS}",
                "security": _CHANGING,
                "parameters": [_CSRF],
            },
        },
        f"{ROOT}/trace.pcapng": {
            "parameters": _in_query(RecordsToCapture),
            "get": _get(
                "What has happened on the lines, for Wireshark",
                {"description": "A capture file", "content": {"application/x-pcapng": {}}},
                _OF_STREAMS,
            ),
        },
    }


def _get(summary: str, ok: dict[str, Any], problems: Collection[int] = ()) -> dict[str, Any]:
    return {"summary": summary, "responses": {"200": ok, **_problems({*_OF_ALL, *problems})}}


def _in_query(kind: type[Any]) -> list[dict[str, Any]]:
    return [_parameter(each, kind, is_in_path=False) for each in parameters_of(kind)]


def _stream(what: str) -> dict[str, Any]:
    return {"description": what, "content": {"text/event-stream": {}}}


def _ok(schema: Schema) -> dict[str, Any]:
    return {"description": "OK", **_in_json(schema)}


def _in_json(schema: Schema) -> dict[str, Any]:
    return {"content": {"application/json": {"schema": schema}}}


def _problems(statuses: set[int]) -> dict[str, Any]:
    content = {"application/problem+json": {"schema": schema_of(Problem)}}
    return {str(status): {"description": _WHATS[status], "content": content} for status in sorted(statuses)}


def _components(operations: Operations) -> dict[str, Schema]:
    """Make the schemas of all types by their names.

    Raises:
        ValueError: two types have the same name.
    """
    types: list[Any] = [Problem, Session, *(each.result for each in operations)]
    asked = [each.parameters for each in operations]
    types += [part for kind in asked for part in _types_in_body(kind).values()]
    bodies = {_BODIES[kind]: _body_schema(kind) for kind in asked if kind in _BODIES}
    found = dict(bodies)
    for name, schema in (each for kind in types for each in schemas_of(kind)[1].items()):
        if found.setdefault(name, schema) != schema:
            raise ValueError(f"two types have the name {name}")
    return dict(sorted(found.items()))


if __name__ == "__main__":
    sys.stdout.write(as_text(document()))
