"""A scan recognises kinds of devices by their profiles. In virtual time, at pace."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.config.load import parse
from gateway.operator.operations.answers.scan import Found, SunSpecModel
from gateway.simulator.described import kind_of
from gateway.simulator.generic import Generic
from gateway.simulator.profiled import Profiled
from gateway.simulator.weigher import Weigher
from kit.asking import answers
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

LINE = '[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 1, profile = "meter" }]\n'
CONFIG = (
    LINE
    + """
[profile.meter]
maker    = "Maker"
identity = { fc43 = "M-1" }

[profile.small]
functions = [3, 6]
identity  = { holding = 100, equals = 0x1234 }

[profile.twin]
identity = { holding = 100, equals = 0x1234 }

[profile.drive]
functions = [3, 4, 6]
identity  = { input = 7, equals = 9 }

[profile.inverter]
functions = [3]
identity  = { sunspec = [1, 802] }
points    = [{ name = "current", holding = 40072, unit = "A" }]

[profile.at-zero]
identity = { holding = 0, equals = 5 }

[profile.of-ascii]
mode     = "ascii"
identity = { holding = 5555, equals = 1 }
"""
)


def device(unit: int, name: str) -> Profiled:
    loaded = parse(CONFIG, port_trouble=lambda port: None, real_path=lambda port: port)
    assert loaded.config is not None
    return Profiled(unit, kind_of(name, loaded.config.profile[name]))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    file = tmp_path / "gateway.toml"
    file.write_text(CONFIG)
    return file


async def scanned(config: Path, units: str, *devices) -> tuple[dict[int, Found], list[bytes]]:
    """What a scan finds, by unit, and the frames that it wrote."""
    async with gateway_bench(LINE.replace('"meter"', '"generic"')) as bench:
        bench.attach_at_pace("hall", *devices)
        frames, line = [], bench.lines["hall"]
        receive = line.on_write
        line.on_write = lambda data: (frames.append(bytes(data)), receive(data))
        request = {"verb": "scan", "line": "hall", "units": units}
        *_, last = await answers(bench.running, request, reloader=SimpleNamespace(file=config))
        return {each.unit: each for each in last["found"]}, frames


async def test_each_kind_is_named_and_those_that_cannot_be_told_apart_are_all_named(config):
    devices = [device(2, "meter"), device(3, "small"), device(4, "drive"), device(5, "inverter")]
    found, _ = await scanned(config, "2-9", *devices, Weigher(6), Generic(7))
    assert {unit: each.profile for unit, each in found.items()} == {
        2: "meter",
        3: "small, twin",
        4: "drive",
        5: "inverter",
        6: "weigher",
        7: "generic",
    }


async def test_sunspec_models_are_told_with_their_addresses(config):
    found, _ = await scanned(config, "4-5", device(4, "drive"), device(5, "inverter"))
    assert found[5].models == (SunSpecModel(1, 40002), SunSpecModel(802, 40070))
    assert found[4].models == ()


async def test_a_unit_is_only_read_and_those_that_do_not_answer_get_one_question(config):
    found, requests = await scanned(config, "3-4", device(3, "small"))
    own = [request for request in requests if request[0] == 3]
    assert {request[1] for request in own} <= {1, 2, 3, 4, 43}
    assert len(set(own)) == len(own) <= 13, "none is asked twice"
    assert len(requests) - len(own) == 1
    assert list(found) == [3]


async def test_kinds_of_the_other_mode_are_not_looked_for(config):
    _, requests = await scanned(config, "3", device(3, "small"))
    assert [request for request in requests if (5555).to_bytes(2, "big") in request] == []


async def test_without_a_config_file_the_shipped_kinds_are_looked_for(tmp_path):
    found, _ = await scanned(tmp_path / "gateway.toml", "3", device(3, "small"))
    assert found[3].profile == "generic"


async def test_a_late_answer_to_one_question_is_none_to_the_next(tmp_path):
    config = tmp_path / "gateway.toml"
    config.write_text("".join(f"[profile.at-{at}]\nidentity = {{ holding = {at}, equals = 7 }}\n" for at in (10, 11)))
    late = SimulatedDevice(3, delay=0.6)
    late.holding[10] = 7
    async with gateway_bench(LINE.replace('"meter"', '"generic"')) as bench:
        bench.attach("hall", SimulatedLine("rtu", late))
        request = {"verb": "scan", "line": "hall", "units": "3"}
        *_, last = await answers(bench.running, request, reloader=SimpleNamespace(file=config))
    assert [(each.result, each.profile) for each in last["found"]] == [("answers", "generic")]
    assert {bytes((3, 0, 10, 0, 1)), bytes((3, 0, 11, 0, 1))} <= {frame.pdu for frame in late.heard}
