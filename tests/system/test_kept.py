"""Nothing measured is lost on its way to the plant: a short form of tests/soak/kept.py, some faults once."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from kit import process
from kit.process import started_anew
from soak import kept_judge as judged
from soak.kept_judge import judge
from soak.kept_stage import PLAIN, PROGRAM, SPARKPLUG, Stage
from soak.kept_world import Loop

pytestmark = pytest.mark.needs("mosquitto")

#: How late a busy machine may be, in seconds.
LATE = 4.0
#: These depend on the pace of the machine.
OF_PACE = {judged.OLD, judged.BEFORE_LIVE}


@pytest.fixture(autouse=True)
def _gateways_connect_again_soon(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(judged, "EARLY", 0.2)  # it looks at the clock and then reads: less than between two values
    monkeypatch.setattr(process, "COMMAND", [sys.executable, "-P", "-c", PROGRAM.format(lie="")])
    with started_anew():
        yield


@pytest.mark.parametrize(
    ("form", "faults"),
    [
        (
            PLAIN,
            {
                "the broker is killed": 1.0,
                "a reload with other values": 0.0,
                "the broker is away, the gateway ends": 1.0,
                "the broker stands still, and is killed": 1.5,
            },
        ),
        (SPARKPLUG, {"the broker is away, the gateway is killed": 1.5 + LATE}),
    ],
)
def test_every_value_comes_once_in_order_with_its_time(tmp_path: Path, form: str, faults: dict[str, float]):
    with Loop() as loop:
        stage = Stage(tmp_path, loop, 1, form, late=LATE)
        with stage.running():
            for kind, lasts in faults.items():
                stage.suffer(kind, lasts)
            stage.wait_until_sent()
            record = stage.record()
    assert [each for each in judge(record) if each.kind not in OF_PACE] == []
    assert any(told.is_history for told in record.heard)
    expected = sum(len(answer.values) for answer in record.answers)
    assert expected > 100, "else this shows nothing"
