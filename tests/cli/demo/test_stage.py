"""What the demo prints when its gateway has refused the first request, on a machine that is too busy."""

import asyncio
from pathlib import Path

from gateway.cli.demo.script import FIRST_QUESTION
from gateway.cli.demo.stage import Stage
from gateway.modbus import mbap


class Refusing:
    """A gateway that answers each request with exception 06."""

    def __init__(self, reader):
        self._reader = reader

    def write(self, request):
        self._reader.feed_data(mbap.encode(int.from_bytes(request[:2]), request[6], bytes((request[7] | 0x80, 6))))


async def test_a_first_request_that_was_on_no_line_is_shown_as_wrong(plan, capsys):
    stage = Stage(Path("gateway.toml"), plan)
    stage._reader = asyncio.StreamReader()
    stage._writer = Refusing(stage._reader)
    assert not await stage.first(FIRST_QUESTION)
    assert "gateway > client" in capsys.readouterr().out
