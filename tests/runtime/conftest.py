"""Files in the state folder have time, on disks of machines that have other things to do."""

import pytest

from kit.process import PATIENCE


@pytest.fixture(autouse=True)
def _patient_with_disks(monkeypatch) -> None:
    monkeypatch.setattr("gateway.state.entry_file.CLOSING_DEADLINE", PATIENCE)
