"""`map` while the gateway runs: how old each value is, as the gateway tells it."""

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.cli.kit.daemon import usual_socket
from gateway.cli.main import FINE, PROBLEM_FOUND, main
from kit.asking import NO_FILE, ControlSocket
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.mapped_hall import CONFIG, attach

MIRROR = """
[[image]]
unit = 241
name = "copy"
of = "meter-2"
stale = "3 s"
read = [{ holding = "0-149", every = "1 s" }, { coils = "0-3", every = "1 s" }]
"""
IMAGE = '[[image]]\nunit = 200\nname = "shift"\nholding = "0-9"\n'


@pytest.fixture
async def bench() -> AsyncIterator[GatewayBench]:
    async with gateway_bench(CONFIG + MIRROR + IMAGE) as bench:
        yield bench


@pytest.fixture
async def meters(bench: GatewayBench) -> dict[str, SimulatedDevice]:
    meters = attach(bench)
    await asyncio.sleep(10)
    return meters


@pytest.fixture
def control(bench, monkeypatch) -> ControlSocket:
    control = ControlSocket(bench.running)
    monkeypatch.setattr("gateway.cli.verbs.map.Conversation", control)
    return control


@pytest.fixture
def config(tmp_path) -> Path:
    path = tmp_path / "gateway.toml"
    path.write_text(CONFIG + MIRROR + IMAGE)
    return path


def ages(capsys, config: Path, *words: str) -> dict[str, str]:
    """What the column AGE says, by the address."""
    assert main(["map", *words, "--config", str(config)]) == FINE
    printed = capsys.readouterr()
    assert printed.err == ""
    _, headings, *lines = printed.out.splitlines()
    age, write = headings.index("AGE"), headings.index("WRITE")
    assert headings.index("EVERY") < age < write
    return {line[: headings.index("REFERENCE")].strip(): line[age:write].strip() for line in lines}


def seconds(age: str, state: str = "") -> float:
    assert age.startswith(state)
    number, unit = age.removeprefix(state).split()
    assert unit == "s"
    return float(number)


async def test_each_value_has_its_age_and_what_is_not_fresh_its_state(bench, meters, control, config, capsys) -> None:
    meters["meter-2"].silent, meters["meter-3"].holding[0] = True, 0x8000
    await asyncio.sleep(5)
    found = ages(capsys, config, "block")
    assert 0 <= seconds(found["holding 0"]) < 1.5
    assert 0 <= seconds(found["holding 1-2"], "invalid") < 1.5
    assert 5 <= seconds(found["holding 20-23"], "stale") < 6.5
    assert "." in found["holding 20-23"]
    assert {place: age for place, age in found.items() if not age} == dict.fromkeys(
        ["holding 90.0", "holding 90.1", "holding 90.2", "holding 91", "holding 200-209"], ""
    )
    await asyncio.sleep(10)
    assert seconds(ages(capsys, config, "block")["holding 20-23"], "stale") in (15, 16)
    await asyncio.sleep(300)
    assert ages(capsys, config, "block")["holding 20-23"] == "stale 5 min"


async def test_what_was_never_read_has_a_dash(bench, control, config, capsys) -> None:
    attach(bench)["meter-3"].silent = True
    await asyncio.sleep(10)
    assert ages(capsys, config, "240")["holding 1-2"] == "–"  # noqa: RUF001 - a dash


async def test_a_polled_range_of_a_mirror_is_as_old_as_its_oldest_part(bench, meters, control, config, capsys) -> None:
    assert all(0 <= seconds(age) < 1.5 for age in ages(capsys, config, "copy").values())
    assert await bench.client().asks(241, "06 00 95 00 07") == "06 00 95 00 07"
    found = ages(capsys, config, "copy")
    assert (list(found), found["holding 0-149"]) == (["coils 0-3", "holding 0-149"], "–")  # noqa: RUF001 - a dash
    await asyncio.sleep(1)
    meters["meter-2"].silent = True
    await asyncio.sleep(6)
    assert all(5 <= seconds(age, "stale") < 7.5 for age in ages(capsys, config, "copy").values())


async def test_programs_get_the_age_in_milliseconds_where_it_is_known(bench, control, config, capsys) -> None:
    attach(bench)["meter-3"].silent = True
    await asyncio.sleep(10)
    assert main(["map", "block", "--json", "--config", str(config)]) == FINE
    rows = {row["first"]: row for row in json.loads(capsys.readouterr().out)["map"]}
    assert [first for first, row in rows.items() if "age_ms" in row] == [0, 3, 20]
    assert 0 <= rows[0]["age_ms"] < 1500


async def test_csv_images_and_devices_have_no_age(bench, meters, control, config, capsys) -> None:
    for words in (["block", "--csv"], ["copy", "--csv"], ["shift"], ["meter-1"]):
        assert main(["map", *words, "--config", str(config)]) == FINE
        printed = capsys.readouterr()
        assert "age" not in printed.out.splitlines()[0].lower().split(",")
        assert ("AGE" in printed.out, printed.err) == (False, "")
    assert control.questions == []


async def test_of_a_changed_config_only_what_is_still_so_has_an_age(bench, meters, control, config, capsys) -> None:
    config.write_text(
        CONFIG.replace('at = 0, device = "meter-1"', 'at = 0, device = "meter-3"')
        .replace(
            'at = 20, device = "meter-2", holding = "100-103", every = "1 s", write = true', 'at = 20, age = "meter-2"'
        )
        .replace('at = 91, age = "meter-2"', 'at = 92, device = "meter-2", holding = 5, every = "1 s"')
    )
    found = ages(capsys, config, "block")
    assert [found[place] for place in ("holding 0", "holding 20", "holding 92")] == ["–", "", "–"]  # noqa: RUF001
    assert seconds(found["holding 3"]) < 1.5
    assert main(["map", "block", "--json", "--config", str(config)]) == FINE
    rows = json.loads(capsys.readouterr().out)["map"]
    assert [row["first"] for row in rows if "age_ms" in row] == [1, 3]


async def test_a_unit_that_the_gateway_does_not_have_yet_is_shown_without_ages(bench, control, config, capsys) -> None:
    config.write_text(CONFIG.replace('"block"', '"blocks"'))
    assert main(["map", "blocks", "--config", str(config)]) == FINE
    printed = capsys.readouterr()
    assert printed.err == 'without ages: the gateway says: nothing has the name "blocks"; did you mean "block"?\n'
    assert "AGE" not in printed.out
    assert "meter-1 holding 0" in printed.out


def test_without_a_gateway_the_map_is_shown_without_ages(config, capsys, tmp_path) -> None:
    for words in ([], ["--json"]):
        assert main(["map", "block", *words, "--config", str(config), "--control", str(tmp_path / "none")]) == FINE
        printed = capsys.readouterr()
        assert printed.err.startswith(f"without ages: no running gateway found ({tmp_path / 'none'}: ")
        assert ("AGE" in printed.out, "age_ms" in printed.out) == (False, False)
        assert "meter-1.power" in printed.out


async def test_only_the_gateway_with_this_config_is_asked(bench, meters, control, config, capsys, monkeypatch) -> None:
    monkeypatch.setattr("gateway.cli.verbs.map.DEFAULT_CONFIG", str(config))
    assert main(["map", "block"]) == FINE
    assert control.meant == (usual_socket(), config)
    assert main(["map", "block", "--config", str(config), "--control", "/run/there.sock"]) == FINE
    assert control.meant == (Path("/run/there.sock"), None)
    config.write_text(CONFIG + '[control]\nsocket = "own.sock"\n')
    assert main(["map", "block", "--config", str(config)]) == FINE
    assert control.meant == (config.parent / "own.sock", None)


@pytest.mark.parametrize("words", [["--control", "/run/there.sock"], []])
async def test_the_map_of_a_gateway_that_is_named_is_that_of_its_config(
    bench, meters, config, capsys, monkeypatch, words
) -> None:
    monkeypatch.setattr("gateway.cli.verbs.map.DEFAULT_CONFIG", "/nonexistent/usual.toml")
    monkeypatch.setenv("MODBUS_GATEWAY_CONTROL", "/run/here.sock")
    control = ControlSocket(bench.running, SimpleNamespace(**vars(NO_FILE) | {"place": str(config)}))
    monkeypatch.setattr("gateway.cli.verbs.map.Conversation", control)
    assert main(["map", "block", *words]) == FINE
    assert control.meant.socket == Path(words[-1] if words else "/run/here.sock")
    assert "AGE" in capsys.readouterr().out


def test_the_map_of_a_gateway_that_is_named_and_is_not_there_is_none(config, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("gateway.cli.verbs.map.DEFAULT_CONFIG", str(config))
    assert main(["map", "block", "--control", str(tmp_path / "none")]) == PROBLEM_FOUND
    assert f"no running gateway found ({tmp_path / 'none'}: " in capsys.readouterr().err


async def test_many_values_are_asked_for_in_parts_that_leave_out_gaps(monkeypatch, capsys, tmp_path) -> None:
    rows = [f'{{ at = {at}, device = "m", holding = "{at}-{at + 9}", every = "10 s" }}' for at in range(0, 950, 10)]
    rows.append('{ at = 60000, device = "m", holding = 0, every = "10 s" }')
    line = '[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 1, name = "m" }]\n'
    text = f'{line}[[image]]\nunit = 240\nname = "block"\nstale = "30 s"\nmap = [{", ".join(rows)}]\n'
    config = tmp_path / "gateway.toml"
    config.write_text(text)
    async with gateway_bench(text) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1, items=1000)))
        control = ControlSocket(bench.running)
        monkeypatch.setattr("gateway.cli.verbs.map.Conversation", control)
        await asyncio.sleep(20)
        found = ages(capsys, config, "block")
        assert len(found) == 96
        assert all(seconds(age) <= 10 for age in found.values())
        windows = [(each["start"], each["end"]) for each in control.questions]
        assert windows == [*((first, first + 99) for first in range(0, 900, 100)), (900, 949), (60000, 60000)]
