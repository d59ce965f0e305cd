"""The benchmark finds out a gateway that loses answers, refuses, lies or speaks too soon."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from kit.process import PATIENCE

TESTS = Path(__file__).parents[1]
FAULTS = ("wrong", "lost", "exceptions", "line faults")

pytestmark = pytest.mark.needs("cc")


def measured(folder: Path, **environment: str) -> tuple[int, list[str]]:
    """The exit code, and the faults that are shown, for `kit/naive_gateway.py` in the gateway's place."""
    package = folder / "gateway" / "cli"
    package.mkdir(parents=True)
    for each in (package, package.parent):
        (each / "__init__.py").touch()
    shutil.copy(TESTS / "kit" / "naive_gateway.py", package / "main.py")
    # In one second a relay that stands still may pass on nothing, and then there is nothing to compare with.
    bench = [sys.executable, TESTS / "bench" / "bench.py", "line19200", "--rounds", "1", "--seconds", "2"]
    own = os.environ | environment | {"PYTHONPATH": str(folder)}
    ended = subprocess.run(bench, capture_output=True, text=True, check=False, timeout=PATIENCE, env=own)
    rows = [[cell.strip() for cell in row.split("|")] for row in ended.stdout.splitlines()]
    (told,) = (row[rows[0].index("faults")] for row in rows if "gateway" in row)
    return ended.returncode, [fault for fault in FAULTS if fault in told]


def test_a_gateway_without_a_fault_passes(tmp_path: Path) -> None:
    assert measured(tmp_path) == (0, [])


@pytest.mark.search
def test_each_fault_is_counted_and_ends_the_benchmark_with_status_1(tmp_path: Path) -> None:
    assert measured(tmp_path, FAULTY="1") == (1, [*FAULTS])
