"""Config files made at random out of the schema, for hypothesis: any key, with any value of its kind.

A key that is new in the schema comes in by itself when its kind of value is known here: `OF_KIND`. `OF_KEY` has those
for which a value of their kind would say too little. What `check` refuses is taken out again, so nothing here knows
what fits together.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Le
from hypothesis import reject
from hypothesis import strategies as st

from gateway.config.checks.units import served_units
from gateway.config.load import parse
from gateway.config.plan.names import all_device_names, device_names
from gateway.config.problem import Path
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.image import Image, Mapped
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.schema.table import Table
from gateway.config.schema.upstream import Upstream
from gateway.config.values.key_types import Kind
from gateway.modbus.codes import Area

#: Tables and lists, as tomllib gives them.
Document = dict[str, Any]

_UNITS = st.integers(1, 40) | st.sampled_from([0, 247, 255, "2-5", "1-247", "5-250", [1, "3-4"], "all"])

#: Values by how the documentation calls their kind; the first one that this begins with counts.
OF_KIND: Mapping[str, st.SearchStrategy[Any]] = {
    "text such as": st.sampled_from(["8E1", "8N2", "7E1", "8N1"]),
    "text": st.sampled_from(["a", "b", "a/2", "a/*", "b/3", "*", "2", "image-2", "c:1/2", "tcp://d:502/2", "x-*"]),
    "size": st.sampled_from(["0", "64 KiB", "4 MiB"]),
    "duration": st.sampled_from(["auto", "0", "0.001 ms", "1 ms", "10 ms", "100 ms", "1 s", "5 min", "168 h"]),
    '`"refuse"`': st.sampled_from(["refuse", "broadcast", 1, 2, 5]),
    'units or `"none"`': _UNITS | st.just("none"),
    "units": _UNITS,
    "addresses": st.sampled_from([0, 20, 65536, "0-9", "16-40", ["0-31", "48-80"], "40001-40010", []]),
    "value": st.integers(0, 65535) | st.booleans(),
    "function": st.sampled_from([1, 2, 3, 4, 5, 6, 15, 16, 17, 22, 23, 43, 65, 127]),
    "table such as": st.dictionaries(st.sampled_from(["1", "2", "3", "4", "16", "65"]), st.integers(1, 3000)),
    "`true`": st.sampled_from([True, False, "only"]),
    "list such as": st.just(["127.0.0.0/8"]),
    "path or `{": st.just("/nowhere/x.pem"),
    "address, or name": st.sampled_from([0, 2, 40, 65535, "weight", "a"]),
    '`"exception"`': st.sampled_from(["exception", "hold", 0, 0x7FC0]),
    "address or range": st.sampled_from([0, 3, 65535, "0-1", "16-19", "1-99", "coils"]),
    "address": st.sampled_from(
        ["tcp://d", "tcp://e:1502", "tcp://127.0.0.1:1", "udp://127.0.0.1:1", "rtu+tcp://[::]:2"]
    ),
}

_PROFILES = st.sampled_from(["generic", "mint", "v80", "weigher", "own"])

OF_KEY: Mapping[tuple[type[Table], str], st.SearchStrategy[Any]] = {
    (PointTable, "name"): st.sampled_from(["a", "b-*", "weight", "*", "a/2"]),
    (PointTable, "scale_from"): st.sampled_from(["a", "b-1", "weight"]),
    (PointTable, "invalid"): st.sampled_from([0x8000, 0xFFFF, 1.5, [0, 1]]),
    (PointTable, "bits"): st.sampled_from(["0-3", "8-15", "4-40"]),
    (ProfileTable, "wide"): st.sampled_from(["all", {"holding": "16-40"}, {"input": "all"}]),
    (ProfileTable, "identity"): st.sampled_from([{"fc43": "a"}, {"holding": 0, "equals": 7}, {"sunspec": [1, 103]}]),
    (PointTable, "labels"): st.dictionaries(st.sampled_from(["0", "1", "70000"]), st.sampled_from(["off", "on"])),
    (Line, "port"): st.sampled_from(["/dev/a", "/dev/b", "/dev/x/a", "rtu+tcp://c:1", "ascii+tcp://c:2"]),
    (Listen, "line"): st.sampled_from(["a", "b"]),
    (Listen, "upstream"): st.sampled_from(["u", "v"]),
    (Upstream, "name"): st.sampled_from(["u", "v", "a"]),
    (Line, "profile"): _PROFILES,
    (Device, "profile"): _PROFILES,
    (Image, "profile"): _PROFILES,
    # With less of the one and more of the other a line takes minutes for a request.
    (Line, "baud"): st.sampled_from([300, 9600, 14400, 1_000_000]),
    (Line, "gap"): st.sampled_from(["auto", "0", "0.001 ms", "1 ms", "20 ms"]),
}

_PLAIN: Mapping[Any, st.SearchStrategy[Any]] = {
    bool: st.booleans(),
    float: st.floats(0.5, 200, width=16),
    str: st.sampled_from(["a", "b"]),
}


@st.composite
def accepted_configs(draw: st.DrawFn) -> str:
    """The text of a file that `check` accepts: devices first, and then what names them or their units."""
    document = draw(_DEVICES)
    config = _accepted(document)
    names = [name for line in config.line for name in all_device_names(line)]
    rows = [(upstream, row) for upstream in config.upstream for row in upstream.units or ()]
    names += [name for upstream, row in rows for name in device_names(upstream, row)]
    units = sorted(served_units(config))
    if names:
        mirrors = _tables(Image, of=st.sampled_from(names), read=st.lists(_POLLED, min_size=1, max_size=2))
        document["image"] += draw(st.lists(mirrors, max_size=2))
        document["image"] += draw(st.lists(_virtual_units(names), max_size=2))
    if config.upstream:
        alone = st.builds(
            lambda bind, upstream: {"bind": bind, "upstream": upstream},
            OF_KIND["address"],
            st.sampled_from([upstream.label for upstream in config.upstream]),
        )
        document["listen"] += draw(st.lists(alone, max_size=2))
    if units:
        serves = st.lists(st.sampled_from(units), min_size=1, max_size=3, unique=True)
        document["line"] += draw(st.lists(_tables(Line, role=st.just("server"), serves=serves), max_size=1))
    _accepted(document)
    return toml(document)


def _accepted(document: Document) -> Config:
    """What a document means when all that `check` refuses has been taken out of it."""
    while True:
        loaded = parse(toml(document), port_trouble=lambda _: None, real_path=str)
        if loaded.config is not None:
            return loaded.config
        wrong = {_present(document, one.path) for one in loaded.problems if one.severity == "error"}
        for path in sorted(wrong, key=_place, reverse=True):
            _take_out(document, path)


def toml(document: Document) -> str:
    """A file with these sections."""
    parts = []
    for section, content in document.items():
        for name, table in content.items() if isinstance(content, dict) else (("", one) for one in content):
            heading = f"[{section}.{name}]" if name else f"[[{section}]]"
            parts.append("\n".join([heading, *(f"{key} = {_inline(value)}" for key, value in table.items()), ""]))
    return "\n".join(parts)


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_inline(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)


def _present(document: Document, path: Path) -> Path:
    """`path`, or if nothing stands there, that of the table in which it is missing."""
    if not path:
        reject()
    *way, last = path
    table: Any = document
    for part in way:
        table = table[part]
    return path if isinstance(table, list) or last in table else _present(document, tuple(way))


def _place(path: Path) -> Sequence[str]:
    """What stands later in a list is behind what stands earlier."""
    return [f"{part:04}" if isinstance(part, int) else part for part in path]


def _take_out(document: Document, path: Path) -> None:
    """Take out what stands at `path`, which is the last one in its list that is taken out."""
    *way, last = path
    table: Any = document
    for part in way:
        table = table[part]
    del table[last]


def _tables(model: type[Table], **given: st.SearchStrategy[Any]) -> st.SearchStrategy[Document]:
    """Tables with what must be given, and any of the other keys."""
    required, optional = dict(given), {}
    for name, field in model.model_fields.items():
        key = field.alias or name
        if key not in given:
            kept = required if field.is_required() else optional
            kept[key] = OF_KEY[model, key] if (model, key) in OF_KEY else _values(field.annotation, field.metadata)
    return st.fixed_dictionaries(required, optional=optional)


def _values(annotation: Any, metadata: Sequence[Any] = ()) -> st.SearchStrategy[Any]:
    """Values of a type of the schema."""
    kind = next((each.name for each in metadata if isinstance(each, Kind)), None)
    if kind is not None:
        return next(values for begins, values in OF_KIND.items() if kind.startswith(begins))
    if annotation is int:
        return st.sampled_from([1, 2, min([9600, *(each.le for each in metadata if isinstance(each, Le))])])
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    if isinstance(annotation, type):
        return st.deferred(lambda: _tables(annotation))
    return _of_compound(get_origin(annotation), get_args(annotation))


def _of_compound(origin: Any, parts: Sequence[Any]) -> st.SearchStrategy[Any]:
    if origin is Annotated:
        return _values(parts[0], parts[1:])
    if origin is Literal:
        return st.sampled_from(parts)
    if origin is tuple:
        return st.lists(_values(parts[0]), max_size=3)
    return st.one_of(_values(part) for part in parts if part is not type(None))


def _rows(model: type[Table], **given: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Document]]:
    return st.lists(_tables(model, **given), max_size=3)


_POLLED = st.builds(
    lambda area, addresses, every: {area: addresses, "every": every},
    st.sampled_from(list(Area)),
    OF_KIND["addresses"],
    OF_KIND["duration"],
)


def _virtual_units(names: Sequence[str]) -> st.SearchStrategy[Document]:
    """Virtual units with ranges of these devices as they are, and with other rows."""
    rows = st.lists(_ranges_of(names) | _tables(Mapped), min_size=1, max_size=4)
    units, stale = st.sampled_from([2, 40, 200, 247, 255]), st.sampled_from(["1 s", "5 min"])
    tables = _tables(Image, unit=units, map=rows, stale=stale)
    return tables.map(lambda table: {key: each for key, each in table.items() if key not in ("of", "read", "initial")})


def _ranges_of(names: Sequence[str]) -> st.SearchStrategy[Document]:
    areas = st.sampled_from([("holding", "holding"), ("input", "holding"), ("discrete", "coils"), ("coils", "coils")])
    return st.builds(
        lambda at, device, area, addresses, more: (
            {"at": at, "device": device, "area": area[0], area[1]: addresses} | more
        ),
        st.sampled_from([0, 16, 40, 60]),
        st.sampled_from(names),
        areas,
        st.sampled_from([0, "0-1", "16-19", "48-58", 3]),
        st.fixed_dictionaries(
            {"every": st.sampled_from(["10 ms", "100 ms", "1 s", "1 min"])},
            optional={"write": st.booleans(), "swap": st.sampled_from(["none", "words"])},
        ),
    )


_PASSING_THROUGH = _rows(Line, role=st.just("client"))
_WITH_DEVICES = _rows(Line, role=st.just("client"), devices=st.lists(_tables(Device), min_size=1, max_size=4))
_DEVICES = st.fixed_dictionaries(
    {
        "line": _PASSING_THROUGH | _WITH_DEVICES,
        "upstream": _rows(Upstream),
        "image": _rows(Image),
        "listen": _rows(Listen),
        "profile": st.fixed_dictionaries({}, optional={"own": _tables(ProfileTable)}),
    }
)
