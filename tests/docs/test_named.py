"""What a user can look up is on its page: each command, and each metric."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.cli.main import VERBS

CHECKOUT = Path(__file__).parents[2]
PAGES = "\n".join(page.read_text(encoding="utf-8") for page in sorted((CHECKOUT / "docs").glob("*.md")))
METRICS = (CHECKOUT / "docs" / "metrics.md").read_text(encoding="utf-8")


def metrics() -> Iterator[str]:
    """Each metric as Prometheus gets it: `Family("counter", NAME, ...)` is NAME_total."""
    for file in sorted((CHECKOUT / "gateway").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in {"Family", "_histogram"}:
                first, *others = (each.value for each in node.args if isinstance(each, ast.Constant))
                name = others[0] if node.func.id == "Family" and others else first
                if name != "histogram":  # `_histogram` calls Family itself
                    yield f"{name}_total" if first == "counter" else name


@pytest.mark.parametrize("verb", VERBS)
def test_each_command_is_on_a_page(verb):
    assert re.search(rf"modbus-gateway {verb}\b", PAGES)


def test_each_metric_is_on_its_page():
    names = set(metrics())
    assert {"requests_total", "request_duration_seconds", "fleet_site_findings"} <= names
    assert {name for name in names if f"`{name}`" not in METRICS} == set()
