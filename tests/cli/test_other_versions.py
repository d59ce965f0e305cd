"""The answers of a gateway of another version: keys may be gone, or new, or hold something else."""

import copy
import json
import socket
from collections.abc import Iterator

import pytest

from gateway.cli.kit import daemon
from gateway.cli.main import main
from gateway.control.server import _line
from gateway.version import __version__
from kit.asking import answers as kit_answers
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }, { unit = 6, name = "press", timeout = "50 ms" }]
"""

READ, WRITE = "03 00 00 00 01", "06 00 00 00 01"
LINES, FACTS = {"after": 0, "lines": True}, {"since": 600.0}
#: What is typed, and what the gateway is asked for it: after two reads, of which one has failed.
VERBS = {
    "read 41 holding 0": [("unit", {"unit": 41}), ("request", {"unit": 41, "pdu": READ})],
    "write 41 holding 0 1": [("unit", {"unit": 41}), ("request", {"unit": 41, "pdu": WRITE})],
    "doctor": [("doctor", {})],
    "status": [("status", {})],
    "status --json": [("status", {})],
    "values": [("values", {})],
    "values 41 --json": [("values", {"unit": 41})],
    "values --csv": [("values", {})],
    "forget 41": [("forget", {"device": 41})],
    "trace --since 10min": [("trace", LINES), ("trace", FACTS)],
    "trace --since 10min --pcapng {file}": [("trace", LINES), ("trace", FACTS)],
    "trace --why 6": [("why", {"who": "6", "count": 5})],
    "scan hall 7": [("scan", {"line": "hall", "units": ["7"]})],
    "bench hall": [("bench", {"line": "hall", "seconds": 1.0, "unit": 41})],
    "calibrate 41": [("unit", {"unit": 41}), *[("times", {"unit": 41})] * 2],
}
GONE = object()


async def answers(asked):
    """What a gateway answers in virtual time."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        found = []
        for unit in (41, 6):
            await ask(bench.running, "request", unit=unit, pdu=READ)
        for verb, question in asked:
            steps = await kit_answers(bench.running, {"verb": verb, **question})
            found += [json.loads(_line({"ok": True, **step})) for step in steps]
        return found


def variants(answer) -> Iterator[tuple[str, object]]:
    """The answer with each of its keys left out, and with something else there."""
    for place in places(answer):
        *way, last = place
        for instead in (GONE, None, {"new": 1}):
            varied = copy.deepcopy(answer)
            holder = varied
            for step in way:
                holder = holder[step]
            if instead is GONE:
                del holder[last]
            else:
                holder[last] = instead
            yield f"{place}: {'gone' if instead is GONE else instead}", varied


def places(value, way=()):
    """Where something is: of a list, its first element only."""
    inside = value.items() if isinstance(value, dict) else enumerate(value[:1]) if isinstance(value, list) else ()
    for step, each in inside:
        if (*way, step) not in {("version",), ("ok",)}:
            yield (*way, step)
            yield from places(each, (*way, step))


def typed(monkeypatch, capsys, words, told):
    """What the command prints if this is the gateway's answer."""
    near, far = socket.socketpair()
    far.sendall(b"".join(json.dumps(each).encode() + b"\n" for each in told))
    far.shutdown(socket.SHUT_WR)
    monkeypatch.setattr(daemon, "_connect", lambda gateway: near)
    with far:
        code = main(words)
    return code, capsys.readouterr()


@pytest.mark.parametrize("words", VERBS)
async def test_no_answer_ends_in_a_traceback(words, monkeypatch, capsys, tmp_path):
    told = await answers(VERBS[words])
    command = words.format(file=tmp_path / "hall.pcapng").split()
    code, said = typed(monkeypatch, capsys, command, told)
    assert "error" not in said.err, said.err
    for place, answer in enumerate(told):
        for what, varied in variants(answer):
            try:
                code, said = typed(monkeypatch, capsys, command, [*told[:place], varied, *told[place + 1 :]])
            except Exception as error:
                raise AssertionError(f"{command}, answer {place}, {what}") from error
            assert code in (0, 1)
            assert code == 0 or said.err or said.out


async def test_the_error_names_both_versions(monkeypatch, capsys):
    unit, answer = await answers(VERBS["read 41 holding 0"])
    del answer["elapsed_ms"]
    answer["version"] = "9.0"
    assert typed(monkeypatch, capsys, ["read", "41", "holding", "0"], [unit, answer])[1].err == (
        "modbus-gateway: error: the gateway's answer is not understood ('elapsed_ms' is missing); "
        f"the gateway has version 9.0, this command {__version__}: restart the service\n"
    )


CLOSED = "the gateway closed the connection before it answered; is it stopping?"
MAY_BE = "  note: the write may have been carried out\n"


async def test_a_write_whose_answer_is_not_understood_may_have_been_carried_out(monkeypatch, capsys):
    unit, answer = await answers(VERBS["write 41 holding 0 1"])
    del answer["elapsed_ms"]
    said = typed(monkeypatch, capsys, ["write", "41", "holding", "0", "1"], [unit, answer])[1].err
    assert said.endswith(": please report this defect\n" + MAY_BE)


async def test_a_write_without_an_answer_may_have_been_carried_out(monkeypatch, capsys):
    told = (await answers(VERBS["write 41 holding 0 1"]))[:1]
    said = typed(monkeypatch, capsys, ["write", "41", "holding", "0", "1"], told)[1].err
    assert said.endswith(f"\nmodbus-gateway: error: {CLOSED}\n{MAY_BE}")


async def test_before_it_is_sent_no_write_was_carried_out_and_after_its_answer_it_was(monkeypatch, capsys):
    unit, read = await answers(VERBS["read 41 holding 0"])
    write = {**read, "pdu": "10 00 00 00 01"}
    show = ["write", "41", "holding", "0", "1", "--show"]
    assert typed(monkeypatch, capsys, show, [unit])[1].err.endswith(f"\nmodbus-gateway: error: {CLOSED}\n")
    said = typed(monkeypatch, capsys, show, [unit, read, write])[1].err
    assert said.endswith(f"\nmodbus-gateway: error: {CLOSED}\n  note: the write was carried out\n")


async def test_what_another_version_tells_in_addition_is_left_out(monkeypatch, capsys):
    (answer,) = await answers(VERBS["doctor"])
    assert answer["ports"]
    for port in answer["ports"]:
        port["new"] = 1
    assert "new" not in typed(monkeypatch, capsys, ["doctor"], [answer])[1].err
