"""The service's units, as systemd reads them."""

import shutil
import subprocess
from pathlib import Path

import pytest

from kit.booted import SERVICE, SOCKET, UNITS
from kit.process import PATIENCE

pytestmark = pytest.mark.needs("systemd-analyze")


def analyze(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *words], capture_output=True, text=True, timeout=PATIENCE, check=False)


def test_systemd_finds_nothing_wrong_with_them(tmp_path: Path) -> None:
    for unit in (SERVICE, SOCKET):
        text = (UNITS / unit).read_text()  # the command need not be installed here
        (tmp_path / unit).write_text(text.replace("/usr/bin/modbus-gateway", shutil.which("true")))
    verified = analyze("verify", tmp_path / SERVICE, tmp_path / SOCKET)
    assert (verified.returncode, verified.stdout + verified.stderr) == (0, "")


def test_the_service_has_hardly_any_rights() -> None:
    assert analyze("security", "--offline=true", "--threshold=18", UNITS / SERVICE).returncode == 0
