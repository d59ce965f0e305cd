"""Lines where an outside client asks us: a panel (ASCII) and a PLC (RTU) read a weigher and an image."""

from pathlib import Path

import pytest

from gateway.events import AnswerWithheld, LineLost, LineReopened
from kit.conversation import Conversation, Stage, conversations
from kit.gateway_bench import gateway_bench

SERVER_LINES = conversations(Path(__file__).with_name("server-lines.conversations"))

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall"
baud    = 9600
devices = [{ unit = 1, as = 41, profile = "weigher", timeout = "400 ms" }, { unit = 2, as = 42, profile = "weigher" }]

[[line]]
name   = "panel"
port   = "/dev/panel"
mode   = "ascii"
role   = "server"
serves = [41, 200]

[[line]]
name         = "plc"
port         = "/dev/plc"
baud         = 9600
role         = "server"
serves       = 41
on_failure   = "silent"
broadcast_to = "all"

[[image]]
unit    = 200
holding = 100
initial.holding = [{ at = 0, values = [7] }]
"""


@pytest.mark.parametrize("conversation", SERVER_LINES, ids=lambda conversation: conversation.title)
async def test_an_outside_client_is_served(conversation: Conversation) -> None:
    async with gateway_bench(CONFIG) as bench:
        await Stage(bench).play(conversation)


async def test_a_lost_port_is_told_and_opened_again() -> None:
    talk = Conversation("", ("panel << :C8030000000134", "panel >> :C8030200072C"))
    async with gateway_bench(CONFIG) as bench:
        bench.lines["panel"].pull()
        bench.lines["panel"].plug()
        await Stage(bench).play(Conversation("", ("wait 2 s", *talk.steps)))
        told = [event.line for event in bench.events if isinstance(event, LineLost | LineReopened)]
        assert told == ["panel", "panel"]


async def test_a_withheld_answer_is_told() -> None:
    steps = ("panel << :290300000002D2", "wait 50 ms", "panel << :C8030000000134", "panel >> :C8030200072C")
    async with gateway_bench(CONFIG) as bench:
        await Stage(bench).play(Conversation("", steps))
        (told,) = (event for event in bench.events if isinstance(event, AnswerWithheld))
        assert (told.line, told.unit, told.elapsed_ms, told.source) == ("panel", 41, 50.0, "gateway.toml:8")
