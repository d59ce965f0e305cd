"""The line in memory keeps the promises of a real port."""

import asyncio

import pytest

from gateway.errors import PortError
from kit.memory import MemoryLine


class User:
    """Notes what its port tells it."""

    def __init__(self):
        self.heard = b""
        self.losses = []

    def received(self, data):
        self.heard += data

    def lost(self, error):
        self.losses.append(str(error))


@pytest.fixture
def user():
    return User()


async def test_bytes_go_both_ways(user):
    line = MemoryLine()
    port = await line.open_port(user)
    port.write(b"ask")
    line.deliver(b"answer")
    assert line.take_written() == b"ask"
    assert line.take_written() == b""
    assert user.heard == b"answer"


async def test_a_device_answers_after_the_write_not_inside_it(user):
    line = MemoryLine(on_write=lambda data: line.deliver(data.upper()))
    port = await line.open_port(user)
    port.write(b"ask")
    assert user.heard == b""
    await asyncio.sleep(0)
    assert user.heard == b"ASK"


async def test_a_paused_port_keeps_what_comes_until_somebody_looks(user):
    line = MemoryLine()
    port = await line.open_port(user)
    port.pause()
    line.deliver(b"an")
    line.deliver(b"swer")
    assert user.heard == b""
    port.read_now()
    assert user.heard == b"answer"
    line.deliver(b"!")
    assert user.heard == b"answer!"


async def test_pulling_the_plug_loses_the_port_once(user):
    line = MemoryLine()
    port = await line.open_port(user)
    line.pull("gone")
    line.pull("gone")
    port.close()
    port.write(b"into the void")
    line.deliver(b"from the void")
    await port.wait_closed()
    assert (user.losses, user.heard, line.written) == (["gone"], b"", b"")


async def test_an_unplugged_line_cannot_be_opened(user):
    line = MemoryLine()
    line.pull("no adapter")
    with pytest.raises(PortError, match="no adapter"):
        await line.open_port(user)
    line.plug()
    await line.open_port(user)
    assert line.openings == 1


async def test_only_one_can_hold_it(user):
    line = MemoryLine("hall-a")
    port = await line.open_port(user)
    with pytest.raises(PortError, match="hall-a is in use"):
        await line.open_port(user)
    port.close()
    assert not line.is_open
    await line.open_port(user)


async def test_closing_is_told_afterwards(user):
    port = await MemoryLine().open_port(user)
    port.close()
    assert user.losses == []
    await port.wait_closed()
    assert user.losses == ["closed"]
