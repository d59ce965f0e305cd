"""No modules of the package import each other in a circle, also not for types only, or when they are loaded later."""

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import gateway

PACKAGE = Path(gateway.__file__).parent
FILES = {
    ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): file
    for file in PACKAGE.rglob("*.py")
}


def imported(module: str) -> Iterator[str]:
    """The modules of the package that one imports, wherever in it that is written."""
    for node in ast.walk(ast.parse(FILES[module].read_text(encoding="utf-8"))):
        match node:
            case ast.Import(names=names):
                yield from (each.name for each in names)
            case ast.ImportFrom(module=str(name), names=names):
                within = [f"{name}.{each.name}" for each in names]
                yield from (each if each in FILES else name for each in within)
            case ast.Call(func=ast.Name(id="import_module"), args=[ast.Constant(value=str(name)), *_]):
                yield name


#: What `CustomUnit.unit` returns: a type only.
UPWARDS = "gateway.images.custom_unit", "gateway.library.unit_client"


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {module: {each for each in imported(module) if each in FILES} for module in FILES}
    graph[UPWARDS[0]].remove(UPWARDS[1])
    assert "gateway.runtime.fleet.shared_line" in graph["gateway.runtime.gateway_line"], "what is loaded later counts"
    TopologicalSorter(graph).prepare()  # raises CycleError, which names them
