"""`calibrate` beside a whole gateway in virtual time: it finds the timing table that a device really has."""

import asyncio
import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.cli.units import active_calibration
from gateway.cli.verbs import calibrate
from gateway.config.load import parse
from gateway.modbus.frame import Frame
from gateway.operator.operations.asked import OneRequest, OneUnit
from gateway.operator.operations.table import REQUEST, UNIT
from gateway.simulator.faults import Faults
from gateway.simulator.mint import Mint
from gateway.simulator.weigher import Weigher
from kit.asking import answers
from kit.control import FakeConversation, Question
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.virtual_time import VirtualTimeLoop

CONFIG = """
[[line]]
name = "motion"
port = "/dev/motion"
mode = "ascii"
baud = 19200
devices = [{ unit = 2, name = "axis-1" }]

[[line]]
name = "hall"
port = "/dev/hall"
baud = 9600
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }]

[[image]]
unit = 200
name = "shift"
holding = 2
"""

#: The document's table: function, items, time in ms.
MINT = {(1, 1): 10, (1, 16): 10, (2, 1): 10, (2, 16): 10, (3, 1): 10, (3, 99): 420, (16, 1): 10, (16, 99): 240}
MINT |= {(23, 1): 14, (23, 99): 500}


class Daemon(FakeConversation):
    """A gateway that lives in virtual time while somebody waits for it."""

    def __init__(self, slow: float) -> None:
        super().__init__(self.answers_to)
        self.loop = VirtualTimeLoop()
        self._bench = gateway_bench(CONFIG)
        self.bench = self.loop.run_until_complete(self._bench.__aenter__())
        self.mint = Mint(2, faults=Faults(slow=slow))
        self.bench.lines["motion"].baud = self.bench.lines["hall"].baud = 0
        self.loop.run_until_complete(self._attach())

    async def _attach(self) -> None:
        self.bench.attach_at_pace("motion", self.mint, mode="ascii")
        self.bench.attach_at_pace("hall", Weigher(1))

    def close(self) -> None:
        self.loop.run_until_complete(self._bench.__aexit__(None, None, None))
        self.loop.close()

    def answers_to(self, question: Question) -> list[Mapping[str, Any]]:
        return self.loop.run_until_complete(answers(self.bench.running, question))

    def sleep(self, seconds: float) -> None:
        self.loop.run_until_complete(asyncio.sleep(seconds))


@pytest.fixture
def daemon(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Daemon]:
    it = Daemon(getattr(request, "param", 0.0))
    clock = SimpleNamespace(monotonic=it.loop.time, sleep=it.sleep)
    monkeypatch.setattr(calibrate, "Conversation", it)
    monkeypatch.setattr(calibrate, "time", clock)
    monkeypatch.setattr(active_calibration, "time", clock)
    yield it
    it.close()


def calibrated(capsys: pytest.CaptureFixture[str], *words: str) -> dict[tuple[int, int], float]:
    """The suggested table: milliseconds by function and items."""
    assert main(["calibrate", "axis-1", "--json", *words]) == 0
    timing = json.loads(capsys.readouterr().out)["timing"]
    return {(row["fc"], row["items"]): row["time_ms"] for row in timing}


def near(found: dict[tuple[int, int], float], table: dict[tuple[int, int], float]) -> bool:
    return found == {key: pytest.approx(table[key], rel=0.1) for key in found}


def test_actively_it_finds_the_table_of_the_document(daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    found = calibrated(capsys, "--active", "--write", "1-99")
    assert near(found, {key: time for key, time in MINT.items() if key[0] != 23})
    assert len(found) == 8


def test_function_23_is_measured_where_the_profile_has_it(
    daemon: Daemon, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    unit = replace(daemon.ask(UNIT, OneUnit(2)), functions=(3, 23))
    ask = daemon.ask
    monkeypatch.setattr(daemon, "ask", lambda asked, *more: unit if asked is UNIT else ask(asked, *more))
    found = calibrated(capsys, "--active", "--write", "1-99")
    assert near(found, MINT)
    assert set(found) == {(3, 1), (3, 99), (23, 1), (23, 99)}


def test_it_writes_nothing_unless_it_is_told_to_and_then_what_was_there(
    daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    line = daemon.bench.lines["motion"]
    line.written.clear()
    calibrated(capsys, "--active")
    assert {frame[2:4] for frame in bytes(line.written).split(b":")[1:]} == {b"01", b"02", b"03", b"04"}
    daemon.ask(REQUEST, OneRequest(2, "10 00 0A 00 02 04 00 07 00 08"))
    calibrated(capsys, "--active", "--write", "10-11")
    assert daemon.ask(REQUEST, OneRequest(2, "03 00 09 00 04")).pdu == "03 08 00 00 00 07 00 08 00 00"


def test_passively_it_finds_it_in_the_traffic_of_clients(daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    async def asks() -> None:
        client = daemon.bench.client()
        for number in range(10_000):
            count = (1, 4, 12, 40, 99)[number % 5]
            assert not (await client.asks(2, f"03 0001 {count:04X}")).startswith("83")
            assert not (await client.asks(2, f"01 0000 {1 + number % 16:04X}")).startswith("81")
            await asyncio.sleep(0.05)

    daemon.ask(REQUEST, OneRequest(2, "02 00 00 00 01"))
    task = daemon.loop.create_task(asks())
    assert main(["calibrate", "axis-1", "--json", "--for", "1min"]) == 0
    told = json.loads(capsys.readouterr().out)
    task.cancel()
    line = daemon.bench.lines["motion"]
    assert sum(row["count"] for row in told["rows"]) == pytest.approx(bytes(line.written).count(b":"), abs=2)
    found = {(row["fc"], row["items"]): row["time_ms"] for row in told["timing"]}
    assert near(found, MINT)
    assert set(found) == {(1, 1), (1, 16), (3, 1), (3, 99)}


def test_without_for_it_takes_what_was_measured_since_the_start(
    daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", "axis-1"]) == 1
    assert "no normal response" in capsys.readouterr().err
    for _ in range(3):
        daemon.ask(REQUEST, OneRequest(2, "03 00 01 00 01"))
    daemon.ask(REQUEST, OneRequest(2, "03 00 00 00 01"))
    assert main(["calibrate", "axis-1"]) == 0
    said = capsys.readouterr().out
    assert "3 responses" in said
    assert '{ fc = 3, items = 1, time = "10' in said
    assert "Only one number of items was seen with function 3" in said
    assert said.endswith("3 responses are too few for a time limit: take at least 100, with --active.\n")


@pytest.mark.parametrize("words", [(), ("--for", "10s")])
def test_every_response_counts_though_the_gateway_keeps_the_times_of_the_last_ones_only(
    daemon: Daemon, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    async def asks(number: int) -> None:
        client = daemon.bench.client()
        for _ in range(number):
            await client.asks(2, "03 00 01 00 01")

    if words:
        daemon.loop.create_task(asks(1000))
    else:
        daemon.loop.run_until_complete(asks(200))
    assert main(["calibrate", "axis-1", *words]) == 0
    said = capsys.readouterr().out
    counted = len(bytes(daemon.bench.lines["motion"].written).split(b":")) - 1
    assert int(said.partition(" responses")[0].rpartition(" ")[2]) == pytest.approx(counted, abs=1)
    assert "are too few for a time limit" not in said
    assert "P50 and P99 are those of the last responses only" in said


def test_too_few_responses_in_a_short_time_ask_for_a_longer_one(
    daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", "axis-1", "--active", "--for", "1s"]) == 0
    assert capsys.readouterr().out.endswith("take at least 100, with a longer --for.\n")


@pytest.mark.parametrize("daemon", [0.03], indirect=True)
def test_a_profile_file_can_be_put_into_a_config(daemon: Daemon, capsys: pytest.CaptureFixture[str], tmp_path) -> None:
    file = tmp_path / "measured.toml"
    assert main(["calibrate", "axis-1", "--active", "--write-profile", str(file)]) == 0
    assert f"{file} is written: modbus-gateway profile add {file}, and name it" in capsys.readouterr().err
    config = CONFIG.replace('name = "axis-1"', 'name = "axis-1", profile = "generic-measured"') + file.read_text()
    loaded = parse(config, port_trouble=lambda port: None, real_path=lambda port: port)
    assert [problem for problem in loaded.problems if problem.severity == "error"] == []
    rows = tomllib.loads(config)["profile"]["generic-measured"]["timing"]
    (first,) = [float(row["time"].removesuffix(" ms")) for row in rows if (row["fc"], row["items"]) == (3, 1)]
    assert first == pytest.approx(40, rel=0.05)
    assert main(["calibrate", "axis-1", "--write-profile", str(file)]) == 1
    assert "File exists" in capsys.readouterr().err


def test_a_device_that_falls_silent_ends_it(daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    daemon.mint.faults = Faults(silent=True)
    assert main(["calibrate", "axis-1", "--active"]) == 1
    said = capsys.readouterr().err
    assert "given up: axis-1: exception 0B" in said
    assert said.endswith("axis-1: no normal response\n")  # and no advice to do what was just done


@pytest.mark.parametrize(
    ("words", "code", "complaint"),
    [
        (["shift"], 1, "the gateway answers unit 200 itself: only devices have a timing table"),
        (["axis"], 1, 'nothing has the name "axis"; did you mean "axis-1"'),
        (["axis-1", "--write", "10"], 2, "--write is for --active"),
    ],
)
def test_what_cannot_be_calibrated(
    daemon: Daemon, capsys: pytest.CaptureFixture[str], words: list[str], code: int, complaint: str
) -> None:
    assert main(["calibrate", *words]) == code
    assert complaint in capsys.readouterr().err


class SilentAboutMany(SimulatedDevice):
    """Does not answer a read of more than 40 items."""

    def ask(self, frame: Frame, encode: Callable[[int, bytes], bytes]) -> list[Answer]:
        answers = super().ask(frame, encode)
        return answers if int.from_bytes(frame.pdu[3:5]) <= 40 else []


def test_a_device_that_is_silent_about_too_many_items_is_measured_and_not_put_to_rest(
    daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    async def attach() -> None:
        daemon.bench.attach("motion", SimulatedLine("ascii", SilentAboutMany(2)))

    daemon.loop.run_until_complete(attach())
    found = calibrated(capsys, "--active")
    assert {key for key in found if key[0] == 3} == {(3, 1), (3, 40)}
    assert not any(event.name == "unit_resting" for event in daemon.bench.events)
