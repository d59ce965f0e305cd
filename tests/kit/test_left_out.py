"""What becomes of tests that cannot run here."""

import os
import subprocess
import sys
from pathlib import Path

from kit import left_out

TESTS = """
import pytest

@pytest.mark.needs("mbpoll", "socat")
def test_with_a_program(): raise AssertionError("must not run")
def test_left_out(): pytest.skip("only root may mount a small disk")
def test_left_out_of_ci(): pytest.skip("there is no udevadm that verifies rules")
@pytest.mark.xfail
def test_expected_to_fail(): assert False
"""


def run(folder: Path, **own: str) -> tuple[str, list[str]]:
    """What pytest prints of TESTS on a machine with no program at all, and what is told at the end."""
    (folder / "test_some.py").write_text(TESTS)
    notes = folder / "notes"
    words = ["-p", "kit.left_out", "--left-out", notes, "-p", "no:cacheprovider", "--rootdir", folder, folder]
    env = {name: value for name, value in os.environ.items() if name not in ("CI", "PYTEST_ADDOPTS")} | {
        "PYTHONPATH": str(Path(__file__).parents[1]),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PATH": str(folder),
        **own,
    }
    code = "import sys, pytest; from kit import programs; programs._PATH = ''; sys.exit(pytest.main(sys.argv[1:]))"
    ran = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, env=env, check=False)
    return ran.stdout, left_out.told(notes.read_text())


def test_what_is_left_out_is_told_with_what_to_install(tmp_path: Path) -> None:
    printed, told = run(tmp_path)
    assert "3 skipped, 1 xfailed" in printed
    assert sorted(told) == [
        "    1 test: mbpoll is not installed (apt install mbpoll)",
        "    1 test: only root may mount a small disk",
        "    1 test: there is no udevadm that verifies rules",
        "to run them: apt install mbpoll",
    ]


def test_ci_leaves_out_only_what_it_cannot_have(tmp_path: Path) -> None:
    printed, _ = run(tmp_path, CI="true")
    assert "1 failed, 1 skipped, 1 xfailed" in printed  # one more is an error, as it had not begun
    assert "1 error" in printed
    assert "only root may mount a small disk: CI leaves no test out" in printed


def test_a_test_that_several_passes_leave_out_counts_once() -> None:
    assert left_out.told('["test_a", "no root"]\n["test_b", "no root"]\n["test_a", "no root"]\n') == [
        "    2 tests: no root"
    ]
