"""The rules where we are the server: framing, and the conformance cases for TCP, asked over both kinds of line."""

import json
from pathlib import Path
from typing import NamedTuple

import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from kit.conversation import Conversation, Stage, conversations
from kit.gateway_bench import gateway_bench

RULES = conversations(Path(__file__).with_name("server-rules.conversations"))
VECTORS = Path(__file__).parents[1] / "vectors" / "conformance-tcp.json"

CONFIG = f"""
[[line]]
name   = "panel"
port   = "/dev/panel"
mode   = "ascii"
role   = "server"
serves = 10

[[line]]
name   = "plc"
port   = "/dev/plc"
role   = "server"
serves = 10

[[image]]
unit     = 10
coils    = 2048
discrete = 2048
holding  = 256
input    = 256
initial.holding = [{{ at = 0, values = {list(range(256))} }}]
initial.input   = [{{ at = 0, values = {list(range(1000, 1256))} }}]
"""


class Case(NamedTuple):
    """A request to a unit, and the PDUs that may answer it; none where there is silence."""

    title: str
    unit: int
    pdu: bytes
    answers: list[bytes]


def cases() -> list[Case]:
    """The cases for TCP that are one request with one answer."""
    found = []
    for case in json.loads(VECTORS.read_text())["cases"]:
        expected = case["expect"]
        if expected["type"] not in {"exact", "oneof"} or len(case["send"]) > 1 or ":" in case["send"][0]:
            continue
        adu, texts = bytes.fromhex(case["send"][0]), expected["hex"]
        answers = [bytes.fromhex(text) for text in ([texts] if isinstance(texts, str) else texts)]
        if int.from_bytes(adu[4:6]) == len(adu) - 6 and all(len(answer) > 7 for answer in answers):
            is_served = adu[6] == 10 and adu[7] < 0x80  # what is set in exceptions only is a response of ours
            pdus = [answer[7:] for answer in answers if int.from_bytes(answer[4:6]) == len(answer) - 6]
            found.append(Case(f"{case['id']} {case['title']}", adu[6], adu[7:], pdus if is_served else []))
    return found


@pytest.mark.parametrize("port", ["panel", "plc"])
@pytest.mark.parametrize("case", cases(), ids=lambda case: case.title)
async def test_a_case_for_tcp_asked_over_a_line(case: Case, port: str) -> None:
    encode = ascii_framing.encode if port == "panel" else rtu.encode
    async with gateway_bench(CONFIG) as bench:
        line = bench.lines[port]
        line.deliver(encode(case.unit, case.pdu))
        await Stage(bench).play(Conversation("", ("wait 1 s",)))
        assert line.take_written() in ([encode(case.unit, answer) for answer in case.answers] or [b""])


@pytest.mark.parametrize("conversation", RULES, ids=lambda conversation: conversation.title)
async def test_a_server_keeps_the_rules(conversation: Conversation) -> None:
    async with gateway_bench(CONFIG) as bench:
        await Stage(bench).play(conversation)


@pytest.mark.parametrize(("values", "answered"), [(123, True), (124, False)])
async def test_the_longest_ascii_frame(values: int, answered: bool) -> None:
    """A11: a write of 123 registers has 511 characters; one of more than 513 is no frame."""
    pdu = bytes((16, 0, 0, 0, values, 2 * values)) + bytes(2 * values)
    async with gateway_bench(CONFIG) as bench:
        line = bench.lines["panel"]
        line.deliver(ascii_framing.encode(10, pdu + b"\0" * (0 if answered else 8)))
        await Stage(bench).play(Conversation("", ("wait 1 s",)))
        assert bool(line.take_written()) is answered
