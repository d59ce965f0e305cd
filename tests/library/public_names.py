"""Writes down what is public of the gateway: each name that it exports, its members, and their signatures.

    PYTHONPATH=. .venv/bin/python tests/library/public_names.py > tests/library/public.txt

A signature is as it is written in the code, which is the same with every version of Python.
"""

import ast
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import gateway
from gateway import events

#: What an event, or a problem, has for the parts of the gateway.
_OF_PARTS = frozenset({"says", "begins", "ends", "of", "field_names", "on_key", "located"})
#: Methods that a program calls by `async with`.
_BY_SYNTAX = frozenset({"__aenter__", "__aexit__"})
#: The decorators that change how a method is used.
_KINDS = frozenset({"property", "classmethod", "staticmethod"})


def public_names() -> Iterator[str]:
    """List what a program may use, one thing a line."""
    for name in gateway.__all__:
        value = getattr(gateway, name)
        if isinstance(value, type):
            yield from _of_class(f"gateway.{name}", value)
        else:
            yield f"gateway.{name}"
    for name in sorted({*events.__all__} - {"Emit", "discard_event"}):
        yield from _of_class(f"gateway.events.{name}", getattr(events, name))


def _of_class(name: str, value: type) -> Iterator[str]:
    written = _class_as_written(value)
    bases = [ast.unparse(base) for base in written.bases]
    yield f"{name}({', '.join(bases)})" if bases else name
    for part in written.body:
        for said in _said(part):
            yield f"{name}.{said}"


def _class_as_written(value: type) -> ast.ClassDef:
    module = importlib.import_module(value.__module__)
    source = Path(gateway.__file__).parents[1].joinpath(*module.__name__.split("."))
    file = source / "__init__.py" if source.is_dir() else source.with_suffix(".py")
    body = ast.parse(file.read_text(encoding="utf-8")).body
    return next(part for part in body if isinstance(part, ast.ClassDef) and part.name == value.__name__)


def _said(part: ast.stmt) -> Iterator[str]:
    """What a statement of a class adds for programs."""
    match part:
        case ast.AnnAssign(target=ast.Name(id=name)) if _is_public(name):
            yield ast.unparse(part)
        case ast.Assign(targets=[ast.Name(id=name)]) if _is_public(name):
            yield ast.unparse(part)
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) if _is_public(name):
            yield _signature(part)
        case ast.FunctionDef(name="__init__") if not (ast.get_docstring(part) or "").startswith("Use "):
            yield _signature(part)


def _signature(function: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    kinds = [each for each in map(ast.unparse, function.decorator_list) if each in _KINDS]
    kinds += ["async"] * isinstance(function, ast.AsyncFunctionDef)
    returned = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    told = f"({ast.unparse(function.args)})" if "property" not in kinds else ""
    return f"{function.name}{told}{returned}" + "".join(f"  {kind}" for kind in kinds)


def _is_public(name: str) -> bool:
    return name in _BY_SYNTAX or (not name.startswith("_") and name not in _OF_PARTS)


if __name__ == "__main__":
    sys.stdout.writelines(f"{line}\n" for line in public_names())
