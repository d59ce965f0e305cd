"""What the compiler is told of classes is true (docs/adr/0012)."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1] / "gateway"
#: What refers to nothing that could refer back.
PLAIN = {"int", "float", "bytes", "str", "bool", "None"}


def classes() -> Iterator[tuple[ast.ClassDef, set[str]]]:
    """All classes, each with what the compiler is told of it."""
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                calls = [each for each in node.decorator_list if isinstance(each, ast.Call)]
                told = [each for each in calls if ast.unparse(each.func) == "mypyc_attr"]
                yield node, {str(word.arg) for each in told for word in each.keywords}


def types_of(node: ast.ClassDef) -> set[str]:
    """The names in the types of what is given to a new one, and of what it declares."""
    made = [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__init__"]
    given = [each.annotation for init in made for each in (*init.args.args, *init.args.kwonlyargs) if each.annotation]
    declared = [each.annotation for each in ast.walk(node) if isinstance(each, ast.AnnAssign)]
    names = {word for each in (*given, *declared) for word in ast.unparse(each).split(" | ")}
    return {name.strip('"') for name in names}


def test_what_the_garbage_collector_does_not_see_refers_to_nothing_that_could_refer_back() -> None:
    unseen = {node.name: node for node, told in classes() if "acyclic" in told}
    assert {"Frame", "Token", "Sent"} <= unseen.keys()
    for name, node in unseen.items():
        assert types_of(node) <= PLAIN | unseen.keys(), name
        assert {ast.unparse(base) for base in node.bases} <= unseen.keys(), name


def test_nothing_that_others_inherit_from_is_used_again() -> None:
    """The compiler refuses it, and would say so only at the end of a release."""
    assert not [node.name for node, told in classes() if {"allow_interpreted_subclasses", "free_list_len"} <= told]


def test_nothing_runs_when_an_object_is_freed() -> None:
    """A new object of a free list would be the one that is being freed, and lose what it has."""
    named = [node.name for node, _ in classes() for each in node.body if getattr(each, "name", "") == "__del__"]
    assert named == []
