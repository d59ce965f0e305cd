"""The document of the API: OpenAPI 3.1, of which the tests check each word against the answers."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gateway import __version__
from gateway.modbus.codes import Area
from gateway.registers.datatypes import DATA_TYPES, SWAPS
from gateway.timing.history import LINE_SLOTS, STEP, UNIT_SLOTS
from gateway.web.api.past import TYPES as PAST_TYPES
from gateway.web.api.schemas import Schema, schemas_of

_WHATS: Final = {
    400: "What was asked for makes no sense",
    401: "A login, or the token, is needed",
    403: "Not allowed; `exception` 1: by [[access]], or the unit has no such function",
    404: "There is no such unit, line or point",
    408: "The body took too long",
    409: "A reload has led this unit's number elsewhere meanwhile: ask again",
    411: "The body has no Content-Length",
    413: "The body is too large",
    415: "The body is not JSON",
    422: "`exception` 2 or 3 of the unit, or a value that does not fit; of a reload: the file was rejected",
    502: "`exception` 10: the unit cannot be reached; or another exception of the unit",
    503: "`exception` 6: the line is too busy; or too many readers",
    504: "`exception` 11: no valid response within the time limit",
}
_ASKING: Final = (400, 401, 403, 404, 409, 422, 502, 503, 504)
_WRITING: Final = (*_ASKING, 408, 411, 413, 415)

_VALUE: Final[Schema] = {"type": ["number", "string", "null"]}


def document(types: Mapping[str, type], cookie: str) -> dict[str, Any]:
    """The document. `types` are the dataclasses of status, with the names `Status`, `Unit` and those of each list.

    `cookie` is that of a session.
    """
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "modbus-gateway",
            "version": __version__,
            "description": "State of the gateway, and values of its units. Addresses are protocol addresses from 0.",
        },
        "paths": _paths(),
        "components": {
            "schemas": {**schemas_of({**types, **PAST_TYPES}), **_schemas()},
            "securitySchemes": {
                "token": {"type": "http", "scheme": "bearer"},
                "session": {"type": "apiKey", "in": "cookie", "name": cookie},
            },
        },
        "security": [{}, {"token": []}, {"session": []}],
    }


def _paths() -> dict[str, Any]:
    unit, units = [_in_path("unit", {"type": "string"}, "A unit ID, or a name")], "/api/v1/units/{unit}"
    point = [*unit, _in_path("name", {"type": "string"}, "The name of a point")]
    place = [
        *unit,
        _in_path("area", {"enum": [str(area) for area in Area]}, "What is addressed"),
        _in_path("start", _address(), "The first address"),
        _in_path("end", _address(), "The last address"),
        _in_query("type", DATA_TYPES, "How values are encoded; default uint16, for bits bit"),
        _in_query("swap", SWAPS, "The order of words and bytes in them; default none"),
    ]
    return {
        "/api/v1/openapi.json": {"get": _get("This document", {"type": "object"})},
        "/api/v1/session": {"get": _get("Who has logged in, and the token for X-CSRF-Token", _ref("Session"))},
        "/api/v1/status": {"get": _get("How the gateway is doing", _ref("Status"))},
        "/api/v1/lines": {"get": _get("Lines, lines where the gateway is the server, other servers", _lists())},
        "/api/v1/lines/{name}": {
            "parameters": [_in_path("name", {"type": "string"}, "Its name")],
            "get": _get("One of them", {"anyOf": [_ref("Line"), _ref("Server"), _ref("Upstream")]}, (404,)),
        },
        "/api/v1/lines/{name}/history": {
            "parameters": [_in_path("name", {"type": "string"}, "Its name"), _hours(LINE_SLOTS)],
            "get": _get("What it did in the last hours", _ref("LinePast"), (400, 404)),
        },
        "/api/v1/units": {"get": _get("Every unit", _ref("Units"))},
        units: {"parameters": unit, "get": _get("A unit, its points and its status", _ref("UnitWithStatus"), (404,))},
        f"{units}/history": {
            "parameters": [*unit, _hours(UNIT_SLOTS)],
            "get": _get("What a unit did in the last hours", _ref("UnitPast"), (400, 404)),
        },
        f"{units}/points": {
            "parameters": unit,
            "get": {**_get("All points that can be read", _ref("Points"), _ASKING), "parameters": [_max_age()]},
            "put": _put("Write points that lie side by side, with one request", _ref("NamedValues")),
        },
        f"{units}/points/{{name}}": {
            "parameters": point,
            "get": _get("One point", _ref("Values"), _ASKING),
            "put": _put("Write one point", _ref("NewValues")),
        },
        f"{units}/{{area}}/{{start}}-{{end}}": {
            "parameters": place,
            "get": _get("Values by their addresses", _ref("Values"), _ASKING),
            "put": _put("Write values, with one request", _ref("NewValues")),
        },
        "/api/v1/images/{unit}/{area}/{start}-{end}": {
            "parameters": place,
            "get": _get("What an image or mirror has, without asking a device", _ref("Cells"), (400, 404, 422)),
        },
        "/api/v1/events": {"get": _events()},
        "/api/v1/trace": {"parameters": [*_of_trace(usual=0), _per_second()], "get": _trace()},
        "/api/v1/trace.pcapng": {"parameters": _of_trace(usual=30), "get": _capture()},
        "/api/v1/reload": {"post": _reload()},
    }


def _schemas() -> dict[str, Schema]:
    """What is no dataclass."""
    return {**_general(), **_of_units(), **_of_values(), **_of_images(), **_to_write()}


def _general() -> dict[str, Schema]:
    return {
        "Problem": _object(
            {
                **{name: {"type": "string"} for name in ("type", "title", "detail")},
                "status": {"type": "integer"},
                "exception": {"type": "integer", "description": "The exception code of a Modbus response"},
                "result": {"type": "string", "description": "Why the gateway itself has answered with the exception"},
                "problems": {"type": "array", "items": {"type": "string"}, "description": "Of a rejected file"},
            },
            ("type", "title", "status", "detail"),
        ),
        "Session": _object(
            {
                "user": {"type": "string", "description": "Empty without a login"},
                "role": {"enum": ["viewer", "operator", None]},
                "may_write": {"type": "boolean"},
                "csrf": {"type": "string"},
            }
        ),
    }


def _of_units() -> dict[str, Schema]:
    status = {"anyOf": [_ref("UnitStatus"), _ref("Image"), _ref("Mirror"), {"type": "null"}]}
    return {
        "Units": _object({"units": {"type": "array", "items": _object(_unit_head())}}),
        "UnitWithStatus": _object(
            {**_unit_head(), "points": {"type": "array", "items": _ref("Point")}, "status": status}
        ),
    }


def _of_values() -> dict[str, Schema]:
    told: dict[str, Schema] = {
        "unit": {"type": "integer"},
        "name": {"type": "string"},
        "area": _area(),
        "values": {"type": "array", "items": _ref("Value")},
        "elapsed_ms": {"type": "number"},
        "errors": {"type": "array", "items": _ref("Failure")},
    }
    value = {"point": {"type": "string"}, "area": _area(), **_value_head(), "unit": {"type": "string"}}
    return {
        "Value": _object(value, ("address", "reference", "value", "registers")),
        "Failure": _object(
            {
                "area": _area(),
                "address": _address(),
                "count": {"type": "integer"},
                "exception": {"type": "integer"},
                "reason": {"type": "string"},
            }
        ),
        "Values": _object(told, ("unit", "name", "values", "elapsed_ms")),
        "Points": _object({**told, "age_ms": {"type": "number"}}, ("unit", "name", "values", "elapsed_ms", "age_ms")),
    }


def _of_images() -> dict[str, Schema]:
    return {
        "Cells": _object(
            {
                "unit": {"type": "integer"},
                "name": {"type": "string"},
                "area": _area(),
                "stale_ms": {"type": ["number", "null"], "description": "Clients get no older values of a mirror"},
                "values": {"type": "array", "items": _ref("Cell")},
            }
        ),
        "Cell": _object(
            {
                **_value_head(),
                "text": {"type": "string", "description": "The value as the page shows it"},
                "state": {"enum": ["fine", "stale", "unknown"]},
                "age_ms": {"type": "number", "description": "Of a mirror's"},
                "writer": {"type": "string", "description": "The client that has written last, if that is known"},
                "written_ms": {"type": "number", "description": "How long ago that was"},
            },
            ("address", "reference", "value", "registers", "text", "state"),
        ),
    }


def _to_write() -> dict[str, Schema]:
    named = _object({"point": {"type": "string"}, "value": _new_value()})
    return {
        "NewValues": _object({"values": {"type": "array", "minItems": 1, "items": _new_value()}}),
        "NamedValues": _object({"values": {"type": "array", "minItems": 1, "items": named}}),
    }


def _value_head() -> dict[str, Schema]:
    return {
        "address": _address(),
        "reference": {"type": "string", "description": "The number in many manuals: holding 0 is 40001"},
        "value": _VALUE,
        "registers": {"type": "array", "items": {"type": "integer", "minimum": 0, "maximum": 65535}},
    }


def _area() -> Schema:
    return {"enum": [str(area) for area in Area]}


def _unit_head() -> dict[str, Schema]:
    return {
        "unit": {"type": "integer"},
        "name": {"type": "string"},
        "kind": {"type": "string", "description": "device, upstream, image or mirror"},
        "profile": {"type": "string"},
        "functions": {"type": ["array", "null"], "items": {"type": "integer"}},
        "limits": {"type": "object", "additionalProperties": {"type": "integer"}},
        "areas": {
            "type": "object",
            "description": "First and last address of each range that exists, by area; all if an area is not there",
            "additionalProperties": {"type": "array", "items": {"type": "array", "items": {"type": "integer"}}},
        },
        "longest_wait_ms": {"type": "number"},
    }


def _lists() -> Schema:
    kinds = {"lines": "Line", "servers": "Server", "upstreams": "Upstream"}
    return _object({key: {"type": "array", "items": _ref(name)} for key, name in kinds.items()})


def _get(summary: str, schema: Schema, problems: Sequence[int] = ()) -> dict[str, Any]:
    return {"summary": summary, "responses": {**_ok(schema), **_problems({401, 403, *problems})}}


def _put(summary: str, schema: Schema) -> dict[str, Any]:
    return {
        "summary": summary,
        "description": "For operators, if `write` is set. Needs the cookie of a login and X-CSRF-Token.",
        "security": [{"session": []}],
        "parameters": [_CSRF],
        "requestBody": {"required": True, "content": {"application/json": {"schema": schema}}},
        "responses": {**_ok(_ref("Values")), **_problems(_WRITING)},
    }


def _reload() -> dict[str, Any]:
    return {
        "summary": "Read the config again",
        "description": "For operators. Needs the cookie of a login and X-CSRF-Token.",
        "security": [{"session": []}],
        "parameters": [_CSRF],
        "responses": {**_ok(_ref("Reload")), **_problems((401, 403, 408, 411, 413, 422, 503))},
    }


def _events() -> dict[str, Any]:
    stream = {"description": "An event in JSON on each `data:` line", "content": {"text/event-stream": {}}}
    return {"summary": "Events as they come", "responses": {"200": stream, **_problems((401, 403, 503))}}


def _trace() -> dict[str, Any]:
    what = (
        "On each `data:` line a record in JSON, as `modbus-gateway trace --json` prints it; what the reader may not "
        'read is null. Also each second `{"kind": "clock"}` with the `time`, and `{"kind": "missed"}` with the `count` '
        "of records that were gone before they could be sent"
    )
    stream = {"description": what, "content": {"text/event-stream": {}}}
    return {
        "summary": "What happens on the lines, as it happens",
        "responses": {"200": stream, **_problems((400, 401, 403, 404, 503))},
    }


def _capture() -> dict[str, Any]:
    file = {"description": "A capture file", "content": {"application/x-pcapng": {}}}
    return {
        "summary": "What has happened on the lines, for Wireshark",
        "responses": {"200": file, **_problems((400, 401, 403, 404, 503))},
    }


def _max_age() -> dict[str, Any]:
    seconds = {"type": "integer", "minimum": 0, "maximum": 60, "default": 0}
    what = "Take what somebody else has read not longer ago than this, in seconds"
    return {"name": "max_age", "in": "query", "schema": seconds, "description": what}


def _of_trace(usual: int) -> list[dict[str, Any]]:
    seconds = {"type": "integer", "minimum": 0, "maximum": 3600, "default": usual}
    function = {"type": "integer", "minimum": 1, "maximum": 127}
    return [
        {"name": "line", "in": "query", "schema": {"type": "string"}, "description": "A line or other server"},
        {"name": "unit", "in": "query", "schema": {"type": "string"}, "description": "A unit ID, or a name"},
        {"name": "function", "in": "query", "schema": function, "description": "A function code"},
        {"name": "client", "in": "query", "schema": {"type": "string"}, "description": "A client, or its address"},
        {"name": "result", "in": "query", "schema": {"type": "string"}, "description": _RESULT},
        {"name": "seconds", "in": "query", "schema": seconds, "description": "Records of so many seconds before now"},
    ]


def _per_second() -> dict[str, Any]:
    schema = {"type": "integer", "minimum": 1, "maximum": 2000}
    what = "At most so many records a second; `clock` then has in `left_out` how many others there were"
    return {"name": "per_second", "in": "query", "schema": schema, "description": what}


_RESULT: Final = "ok, exception, failed (all others), or one of these: timeout, resting, queue_full, denied, ..."
_CSRF: Final = {"name": "X-CSRF-Token", "in": "header", "required": True, "schema": {"type": "string"}}


def _ok(schema: Schema) -> dict[str, Any]:
    return {"200": {"description": "It is so", "content": {"application/json": {"schema": schema}}}}


def _problems(statuses: Sequence[int] | set[int]) -> dict[str, Any]:
    content = {"application/problem+json": {"schema": _ref("Problem")}}
    return {str(status): {"description": _WHATS[status], "content": content} for status in sorted(statuses)}


def _object(properties: Mapping[str, Schema], required: Sequence[str] | None = None) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties if required is None else required),
        "additionalProperties": False,
    }


def _ref(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}


def _address() -> Schema:
    return {"type": "integer", "minimum": 0, "maximum": 65535}


def _new_value() -> Schema:
    return {"type": ["number", "string", "boolean"]}


def _hours(slots: int) -> dict[str, Any]:
    hours = {"type": "integer", "minimum": 1, "maximum": slots * STEP // 3600, "default": 24}
    return {"name": "hours", "in": "query", "schema": hours, "description": "So many hours up to now"}


def _in_path(name: str, schema: Schema, what: str) -> dict[str, Any]:
    return {"name": name, "in": "path", "required": True, "schema": schema, "description": what}


def _in_query(name: str, choices: Sequence[str], what: str) -> dict[str, Any]:
    return {"name": name, "in": "query", "schema": {"enum": list(choices)}, "description": what}
