"""`values`: a row for each point, as the gateway has heard it; for people, programs and spreadsheets."""

import asyncio
import csv
import json
from collections.abc import AsyncIterator, Mapping
from io import StringIO
from typing import Any

import pytest

from gateway.cli.kit.paint import red
from gateway.cli.main import FINE, PROBLEM_FOUND, main
from gateway.cli.verbs.values import _screen
from gateway.errors import DaemonError
from gateway.operator.operations.answers.known_values import KnownValues
from kit.asking import ControlSocket, ask
from kit.control import Question
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo 1", profile = "silo" }, { unit = 6, name = "press" }]

[[image]]
unit = 240
name = "copy"
of = "silo 1"
read = [{ holding = "0-1", every = "2 s" }]

[profile.silo]
points = [
    { name = "weight", holding = 0, type = "float32", unit = "kg", decimals = 2 },
    { name = "mode", input = 3, labels = { 0 = "off, now" } },
    { name = "level", input = 4, invalid = 0xFFFF },
]
"""


@pytest.fixture
async def bench() -> AsyncIterator[GatewayBench]:
    async with gateway_bench(CONFIG) as bench:
        device = SimulatedDevice(1)
        device.holding[:2], device.input[3:5] = [0x459C, 0x3D51], [0, 0xFFFF]
        bench.attach("hall", SimulatedLine("rtu", device, SimulatedDevice(6)))
        await asyncio.sleep(5)
        yield bench


@pytest.fixture(autouse=True)
def control(bench, monkeypatch) -> ControlSocket:
    control = ControlSocket(bench.running)
    monkeypatch.setattr("gateway.cli.verbs.values.Conversation", control)
    return control


async def heard(bench: GatewayBench) -> None:
    """A client has read the input registers, half a minute ago."""
    await bench.client().asks(41, "04 00 03 00 02")
    await asyncio.sleep(30)


async def test_a_row_for_each_point_tells_what_was_heard_of_it(bench, capsys) -> None:
    await heard(bench)
    assert main(["values"]) == FINE
    headings, *rows = [line.split("  ") for line in capsys.readouterr().out.splitlines()]
    assert [cell.strip() for cell in headings if cell] == ["DEVICE", "POINT", "VALUE", "UNIT", "STATE", "AGE", "SOURCE"]
    weight, mode, level = [[cell.strip() for cell in row if cell.strip()] for row in rows]
    assert [*weight[:5], weight[6]] == ["silo 1", "weight", "4999.66", "kg", "fresh", "mirror copy"]
    assert weight[5].endswith(" s")
    assert mode == ["silo 1", "mode", "off, now", "fresh", "30 s", "10.0.0.9:49152"]
    assert level[:4] == ["silo 1", "level", "–", "invalid"]  # noqa: RUF001


async def test_names_are_shortened_for_a_screen_but_not_for_grep(capsys, monkeypatch) -> None:
    name = "active-power-import-demand-max-of-the-billing-period"
    async with gateway_bench(CONFIG.replace('"weight"', f'"{name}"')) as bench:
        monkeypatch.setattr("gateway.cli.verbs.values.Conversation", ControlSocket(bench.running))
        monkeypatch.setenv("COLUMNS", "80")
        assert main(["values"]) == FINE
        assert name not in capsys.readouterr().out
        monkeypatch.delenv("COLUMNS")
        assert main(["values"]) == FINE
        assert name in capsys.readouterr().out


async def test_nothing_that_was_never_heard_has_a_value_or_an_age(capsys) -> None:
    assert main(["values", "41"]) == FINE
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows[2] == ["silo", "1", "mode", "–", "never"]  # noqa: RUF001


async def test_programs_get_all_that_the_gateway_tells(bench, capsys) -> None:
    await heard(bench)
    assert main(["values", "silo 1", "--json"]) == FINE
    told = json.loads(capsys.readouterr().out)
    weight, mode, level = told["values"]
    assert (weight["name"], weight["unit"], weight["value"], weight["measure"]) == ("silo 1", 41, 4999.66, "kg")
    assert (mode["value"], level["value"], level["state"]) == ("off, now", None, "invalid")
    assert told["hint"] == ""


async def test_the_csv_has_the_same_columns_always(bench, capsys) -> None:
    await heard(bench)
    assert main(["values", "--csv"]) == FINE
    printed = capsys.readouterr().out
    assert printed.splitlines()[0] == "device,point,value,unit,state,age,source,time"
    weight, mode, level = csv.DictReader(StringIO(printed))
    assert (weight["value"], mode["value"], level["value"]) == ("4999.66", "off, now", "")
    assert (mode["age"], mode["state"], mode["source"]) == ("30.0", "fresh", "10.0.0.9:49152")


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("press", "press has no points: modbus-gateway profile list"),
        ("copy", "copy is answered by the gateway itself: modbus-gateway read copy"),
    ],
)
async def test_a_unit_without_values_says_what_to_do(capsys, unit, said) -> None:
    assert main(["values", unit]) == FINE
    assert capsys.readouterr().out.startswith(said)


async def test_without_any_point_it_says_how_to_get_some(bench, capsys) -> None:
    await bench.reload('[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 6, name = "press" }]\n')
    for words in ([], ["--json"]):
        assert main(["values", *words]) == FINE
        printed = capsys.readouterr().out
        assert "modbus-gateway profile list" in printed
        assert "modbus-gateway import csv" in printed


async def test_a_device_that_there_is_not_is_an_error_with_the_nearest_name(capsys) -> None:
    assert main(["values", "silo"]) == PROBLEM_FOUND
    assert 'did you mean "silo 1"' in capsys.readouterr().err


async def test_a_narrow_terminal_shortens_names_and_no_value(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "56")
    assert main(["values"]) == FINE
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 56
    assert "4999.66" in printed


async def test_on_a_screen_one_device_can_be_chosen_and_what_is_not_fresh_has_a_colour(bench) -> None:
    await heard(bench)
    answer = await ask(bench.running, "values")
    known = KnownValues(answer["values"], answer["hint"])
    screen = _screen(known, 80, "")
    assert screen.parts == ["silo 1"]
    assert [red("invalid") in line for line in screen.lines] == [False, False, False, True]
    assert _screen(known, 80, "silo 1").lines == screen.lines
    assert "silo 1" not in "".join(_screen(known, 80, "other").lines)


async def test_w_shows_them_again_and_again(control, monkeypatch, capsys) -> None:
    def asked_twice(question: Question) -> list[Mapping[str, Any]]:
        if len(control.questions) > 2:
            raise DaemonError("the gateway closed the connection")
        return told(question)

    told = control._answers
    monkeypatch.setattr(control, "_answers", asked_twice)
    monkeypatch.setattr("gateway.cli.kit.watching.EVERY", 0.0)
    assert main(["values", "-w"]) == PROBLEM_FOUND
    printed = capsys.readouterr()
    assert printed.out.count("weight") == 2
    assert "the gateway closed the connection" in printed.err
