"""docs/configuration.md says what the schema says."""

import subprocess
import sys
from pathlib import Path

import pytest

from deploy.reference import EXAMPLE, SMALLEST, document
from gateway.config.load import parse

PAGE = Path(__file__).parents[3] / "docs" / "configuration.md"


def test_the_page_is_current():
    assert PAGE.read_text(encoding="utf-8") == document(), "not current: uvx nox -s gen"


def test_the_page_can_be_made_as_it_says():
    made = subprocess.run([sys.executable, "-m", "deploy.reference"], capture_output=True, check=True, text=True)
    assert made.stdout == document()


@pytest.mark.parametrize("text", [SMALLEST, EXAMPLE])
def test_its_examples_have_no_error(text):
    loaded = parse(text, port_trouble=lambda _: None)
    assert [one for one in loaded.problems if one.severity == "error"] == []


@pytest.mark.parametrize(
    "row",
    [
        "| `input` | address or range |  | The same for input registers. |",
        "| `baud` | number | `19200` | Any rate; 14400 and other odd ones are set as custom rates. |",
        "| `broadcast` | `true` or `false` | `true` | Whether broadcasts go to this line too. |",
        '| `mode` | `"rtu"` or `"ascii"` | `"rtu"` | What is spoken on the line. |',
        "| `values` | list of values | **must be given** | The values: 0-65535, or `true` and `false`. |",
        "| `functions` | list of functions |  | Functions that are allowed, and no others. |",
        "| `read` | list of tables |  | Mirrors: what to poll, and how often. |",
        "| `margin` | number | `1.5` | Times are multiplied by it, to be safe. |",
    ],
)
def test_a_row_says_how_a_value_is_written_and_what_it_is_without_it(row):
    assert row in document().splitlines()


def test_tables_that_are_alike_are_told_once():
    heading = "#### In `image.initial.holding`, `image.initial.input`, `image.initial.coils`, `image.initial.discrete`"
    assert document().splitlines().count(heading) == 1
