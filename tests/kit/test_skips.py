"""What `--skip-only` does to tests that are skipped, and leaves alone."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = """
import pytest

def test_skipped(): pytest.skip("there is no socat")
def test_skipped_elsewhere(): pytest.skip("there is no systemd")
@pytest.mark.xfail
def test_expected_to_fail(): assert False
def test_found_to_fail(): pytest.xfail("not yet")
"""


def test_only_what_is_skipped_for_another_reason_fails(tmp_path: Path) -> None:
    (tmp_path / "test_some.py").write_text(TESTS)
    words = ["-p", "kit.skips", "--skip-only", "no systemd", "-p", "no:cacheprovider", "--rootdir", tmp_path, tmp_path]
    own = {
        **os.environ,
        "PYTHONPATH": str(Path(__file__).parents[1]),
        "PYTEST_ADDOPTS": "",
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
    }
    ran = subprocess.run([sys.executable, "-m", "pytest", *words], capture_output=True, text=True, env=own, check=False)
    assert "there is no socat: this was not expected here" in ran.stdout
    assert "1 failed, 1 skipped, 2 xfailed" in ran.stdout
