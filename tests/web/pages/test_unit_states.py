"""What pages say of units and lines: states of the last minutes, and what doctor says must be fixed."""

import asyncio
from types import SimpleNamespace

import pytest

from gateway.diagnosis.evidence import PortEvidence
from gateway.diagnosis.finding import Finding
from gateway.operator.operations.answers.trouble import Trouble
from gateway.operator.status.unit_states import states_of
from gateway.timing.history import STEP, History, UnitUse
from gateway.tools.examinations import Report
from gateway.web.pages.heat_map import kind_of
from gateway.web.pages.situation import with_findings
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

NOON = 1_777_636_800.0
FINE = UnitUse(requests=200, responses=200)

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 6, name = "press" }, { unit = 7, name = "oven" }, { unit = 8, name = "unused" }]
"""


def state(*uses: UnitUse, now: str = "fine", sent: int = 9) -> str:
    """The state after these slots, the last one of now."""
    history = History()
    for ago, use in enumerate(reversed(uses)):
        history.add(NOON - ago * STEP, {}, {"silo": use})
    unit = SimpleNamespace(name="silo", line="hall", state=now, counts=SimpleNamespace(sent=sent))
    return states_of([unit], history.last(NOON, 144))["silo"].word


@pytest.mark.parametrize(
    ("uses", "now", "expected"),
    [
        ((FINE, FINE), "fine", "fine"),
        ((FINE, FINE._replace(timeouts=1)), "failing", "fine"),
        ((FINE, FINE._replace(timeouts=12, failed=8)), "fine", "failing"),
        ((FINE._replace(timeouts=40), UnitUse(requests=4, responses=4)), "fine", "failing"),
        ((FINE._replace(timeouts=40), FINE, FINE), "fine", "fine"),
        ((UnitUse(requests=4, timeouts=2, responses=2),), "fine", "fine"),
        ((UnitUse(requests=2, timeouts=2),), "failing", "failing"),
        ((FINE,), "resting", "resting"),
        ((FINE._replace(timeouts=2, unsent=24),), "fine", "failing"),
        ((FINE._replace(requests=1000, responses=1000), FINE._replace(timeouts=2, unsent=24)), "fine", "failing"),
    ],
)
def test_a_state_is_that_of_the_last_minutes(uses, now, expected):
    assert state(*uses, now=now) == expected


@pytest.mark.parametrize("requests", [1, 4, 30, 200])
def test_the_state_is_failing_exactly_if_the_column_beside_it_is_red(requests):
    for unanswered in range(requests + 1):
        use = UnitUse(requests=requests, timeouts=unanswered // 2, unsent=unanswered - unanswered // 2, responses=1)
        is_red = kind_of(use) in ("many", "none")
        assert (state(FINE._replace(requests=5000), use) == "failing") == is_red, use


def test_a_unit_that_nobody_has_asked_is_not_fine():
    assert state(sent=0) == "not asked"
    assert state(UnitUse(requests=5, unsent=2), sent=0) == "fine"


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        await asyncio.sleep(1)
        yield bench


async def test_units_that_nobody_has_asked_are_shown_so(bench):
    await bench.inner.client().asks(6, "03 00 00 00 01")
    texts = Markup((await bench.browser().get("/")).text)
    found = {row[0].split()[0]: row[1] for row in texts.rows() if row[0].startswith(("press", "unused"))}
    assert found == {"press": "fine", "unused": "not asked"}
    assert "not asked" in (await bench.browser().get("/units/unused")).text


async def test_units_of_a_line_that_is_down_are_not_counted_as_answering(bench):
    await bench.inner.client().asks(6, "03 00 00 00 01")
    bench.inner.lines["hall"].pull()
    await asyncio.sleep(3)
    page = Markup((await bench.browser().get("/")).text)
    assert {row[1] for row in page.rows() if row[0].startswith(("press", "oven", "unused"))} == {"line down"}
    assert "0/3 units answering" in " ".join(" ".join(page.texts).split())
    assert "line down" in (await bench.browser().get("/units/press")).text


async def test_what_health_says_must_be_fixed_is_on_the_first_page(bench):
    for _ in range(3):
        await bench.inner.client().asks(7, "03 00 00 00 01")
    page = (await bench.browser().get("/")).text
    assert "does not answer at address 7" in page
    assert "/dev/hall does not exist" in page
    units = page.index('id="units"')
    assert page.index('href="/units/oven"', units) < page.index('href="/units/press"', units)
    assert '<a href="/health">Health</a> · 2 to fix' in page


async def test_if_nothing_is_wrong_it_is_said(bench, monkeypatch):
    look = "gateway.tools.examinations.look_at"
    monkeypatch.setattr(look, lambda port, _: PortEvidence(port.line, port.source, port.port, may_open=True))
    await bench.inner.client().asks(6, "03 00 00 00 01")
    page = (await bench.browser().get("/")).text
    assert "All lines are up, and all units that were asked answer." in page
    assert "nothing to fix" not in page.partition("Health</a> · 1 note")[2][:200]


async def test_rows_of_health_lead_to_lines_and_units(bench):
    for _ in range(3):
        await bench.inner.client().asks(7, "03 00 00 00 01")
    page = (await bench.browser().get("/health")).text
    assert '<a href="/units/oven">unit 7, oven</a>' in page
    assert '<a href="/lines/hall">hall</a>' in page


def test_each_line_and_unit_has_one_row_and_what_is_down_is_said_once():
    report = Report(
        NOON,
        (
            (
                "hall",
                (
                    Finding("fix", "hall", "another client"),
                    Finding("fix", "unit 6, press", "96 damaged", unit="press"),
                    Finding("fix", "unit 6, press", "40 late", unit="press"),
                    Finding("note", "unit 7, oven", "one late", unit="oven"),
                ),
            ),
            ("east", (Finding("fix", "east", "is down: unplugged"),)),
            ("", (Finding("fix", "client 10.2.0.7 of default", "left 3 times"),)),
        ),
    )
    known = [Trouble("down", "lines", "east", reason="unplugged"), Trouble("failing", "units", "press", "hall")]
    assert [(each.kind, each.name, each.found) for each in with_findings(known, report)] == [
        ("down", "east", ()),
        ("failing", "press", ("96 damaged", "40 late")),
        ("fix", "hall", ("another client",)),
        ("fix", "client 10.2.0.7 of default", ("left 3 times",)),
    ]


async def test_who_uses_a_line_is_on_its_page_and_on_the_first_one(bench):
    for _ in range(20):
        await bench.inner.client().asks(6, "03 00 00 00 01")
    page = (await bench.browser().get("/lines/hall")).text
    assert "Who used the line in the last minute" in page
    rows = [row for row in Markup(page).rows() if row[0].startswith("127.0.0.1")]
    assert rows[0][1:3] == ["press 6", "03 read holding"]
    assert 'href="/traffic?line=hall"' in page
    assert "127.0.0.1: press 03" in " ".join(Markup((await bench.browser().get("/")).text).texts)
