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
        text = (UNITS / unit).read_text()  # neither the command nor its manual is installed here
        (tmp_path / unit).write_text(text.replace("/usr/bin/modbus-gateway", shutil.which("true")))
    verified = analyze("verify", "--man=no", tmp_path / SERVICE, tmp_path / SOCKET)
    assert (verified.returncode, verified.stdout + verified.stderr) == (0, "")


def test_the_service_has_hardly_any_rights() -> None:
    assert analyze("security", "--offline=true", "--threshold=19", UNITS / SERVICE).returncode == 0


def test_the_service_may_use_more_than_is_promised_but_not_the_whole_machine() -> None:
    """1000 clients take at most 128 MiB; each line and upstream may need a thread."""
    rows = (row.partition("=") for row in (UNITS / SERVICE).read_text().splitlines())
    limits = {key: value for key, _, value in rows}
    assert limits["MemoryMax"].endswith("M")
    assert 2 * 128 <= int(limits["MemoryMax"].removesuffix("M")) <= 512
    assert 256 <= int(limits["TasksMax"]) <= 1024
