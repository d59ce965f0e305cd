"""The packages say which of their modules is for what: what they name is there."""

import ast
import re
from pathlib import Path

import pytest

import gateway

ROOT = Path(gateway.__file__).parent
ROOMS = sorted(path for path in ROOT.rglob("__init__.py") if path.parent != ROOT)


def named(room: Path) -> list[str]:
    """The modules in a list of the docstring: `- queue, scheduler    what waits`."""
    told = ast.get_docstring(ast.parse(room.read_text(encoding="utf-8"))) or ""
    rows = re.findall(r"^- (.+?)  ", told, re.MULTILINE)
    return [name for row in rows for name in row.split(", ")]


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: str(room.parent.relative_to(ROOT)))
def test_each_package_says_what_it_is_for_and_names_only_modules_that_it_has(room: Path) -> None:
    assert ast.get_docstring(ast.parse(room.read_text(encoding="utf-8")))
    there = {path.stem for path in room.parent.iterdir()}
    assert set(named(room)) <= there
