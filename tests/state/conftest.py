"""Files in the state folder have time, on disks of machines that have other things to do."""

import pytest

from kit.process import PATIENCE


@pytest.fixture(autouse=True)
def _patient_with_disks(monkeypatch) -> None:
    for deadline in ("CLOSING_DEADLINE", "LOCK_DEADLINE"):
        monkeypatch.setattr(f"gateway.state.shared_file.{deadline}", PATIENCE)
