"""The rules of both kinds of line, as conversations through the whole gateway."""

from pathlib import Path

import pytest

from kit.conversation import Conversation, Stage, conversations
from kit.gateway_bench import gateway_bench

LINE_RULES = conversations(Path(__file__).with_name("line-rules.conversations"))
LATE_ANSWERS = conversations(Path(__file__).with_name("late-answers.conversations"))

CONFIG = """
[[listen]]
bind  = "tcp://127.0.0.1:0"
unit0 = "broadcast"

[[line]]
name    = "rtu"
port    = "/dev/rtu"
baud    = 19200
format  = "8E1"
devices = [{ unit = 1, timeout = "200 ms" }]

[[line]]
name      = "ascii"
port      = "/dev/ascii"
mode      = "ascii"
baud      = 9600
format    = "7E1"
broadcast = false
devices   = [{ unit = 2, timeout = "300 ms" }, { unit = 3, timeout = "3 s" }]
"""


@pytest.mark.parametrize("conversation", LINE_RULES, ids=lambda conversation: conversation.title)
async def test_a_line_keeps_the_rules(conversation: Conversation) -> None:
    async with gateway_bench(CONFIG) as bench:
        await Stage(bench).play(conversation)


#: Limits of a question for one register: 4 ms for the answer on the wire, the time-out, 5 ms for the port.
LINES_WITH_FAULTS = """
[[line]]
name    = "rtu"
port    = "/dev/rtu"
baud    = 19200
devices = [{ unit = "1-2", timeout = "200 ms" }, { unit = 3, timeout = "50 ms" }]

[[line]]
name    = "echo"
port    = "/dev/echo"
baud    = 19200
echo    = true
devices = [{ unit = 11, timeout = "200 ms" }]
"""


@pytest.mark.parametrize("conversation", LATE_ANSWERS, ids=lambda conversation: conversation.title)
async def test_a_line_never_lies_and_never_stalls(conversation: Conversation) -> None:
    async with gateway_bench(LINES_WITH_FAULTS) as bench:
        await Stage(bench).play(conversation)
