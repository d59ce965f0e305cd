"""No class of the package holds more than eighteen things: what is larger is several parts in one."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import gateway

MOST = 18
PACKAGE = Path(gateway.__file__).parent
#: A table of the config file has an attribute for each of its keys, and those are the operator's.
TABLES = frozenset(
    {
        "gateway.config.schema.line.Line",
        "gateway.config.schema.upstream.Upstream",
        "gateway.config.schema.profile.ProfileTable",
        "gateway.config.schema.profile.PointTable",
        "gateway.config.schema.image.Mapped",
    }
)
#: What such a table says of a point. One object for all that is known of a failure: a second one would cost the ring
#: 50 bytes more.
#: And what the rules of `doctor` look at: a line, a unit, each fact for itself. And the status, with a list for each
#: kind of part, and what it says of a broker and of NATS. And the event with the most to tell.
RECORDS = frozenset(
    {
        "gateway.profiles.point.Point",
        "gateway.events.clients.WriteAudit",
        "gateway.trace.records.Incident",
        "gateway.diagnosis.evidence.LineEvidence",
        "gateway.diagnosis.evidence.UnitEvidence",
        "gateway.operator.operations.answers.status.Status",
        "gateway.plant.status.BrokerStatus",
        "gateway.fleet.status.FleetStatus",
    }
)
#: Not split yet.
TOO_LARGE = frozenset({"gateway.lines.counts.Counts"})


@cache
def module(name: str) -> ast.Module | None:
    """The module of this name, if it is one of the package's."""
    path = PACKAGE.parent / Path(*name.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(file.read_text(encoding="utf-8")) if file.is_file() else None


def class_names() -> Iterator[tuple[str, str]]:
    """Module and name of each class."""
    for file in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        for node in module(name).body:
            if isinstance(node, ast.ClassDef):
                yield name, node.name


def attributes(module_name: str, class_name: str) -> set[str]:
    """The names of what an instance holds, with what it inherits from classes of the package."""
    tree = module(module_name)
    if tree is None:
        return set()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and any((name.asname or name.name) == class_name for name in node.names):
            (original,) = (name.name for name in node.names if (name.asname or name.name) == class_name)
            return attributes(node.module, original)
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            bases = (ast.unparse(base).partition("[")[0] for base in node.bases)
            return own_attributes(node).union(*(attributes(module_name, base) for base in bases))
    return set()


def own_attributes(node: ast.ClassDef) -> set[str]:
    """What the class declares as a field, and what any of its methods sets on `self`."""
    fields = {each.target.id for each in node.body if isinstance(each, ast.AnnAssign)}
    found = (each for each in ast.walk(node) if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store))
    return fields | {each.attr for each in found if isinstance(each.value, ast.Name) and each.value.id == "self"}


def test_no_class_has_more_than_eighteen_attributes() -> None:
    sizes = {f"{name}.{each}": len(attributes(name, each)) for name, each in class_names()}
    assert {name for name, size in sizes.items() if size > MOST} == TABLES | RECORDS | TOO_LARGE


def test_inherited_and_imported_attributes_are_counted() -> None:
    own = {"_arrivals", "_awaited", "_state", "_waiting"}
    assert own | {"in_progress", "caller"} <= attributes("gateway.listeners.sessions.over_tcp", "OverTcpSession")
    assert attributes("gateway.images.persistent", "PersistentImage") >= {"diagnostics", "_store"}
