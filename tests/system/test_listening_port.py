"""The port of a line that only listens cannot send: seen on pseudo-terminals, and at a device server.

What only a UART has (RTS, DTR, RS-485) is seen by tests/qemu/uart.py.
"""

import asyncio
import fcntl
import io
import os
import re
import termios
import time
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway.errors import PortClosed, PortError
from gateway.ports.opener import make_opener
from gateway.ports.port import SerialSettings, TcpSettings
from gateway.timing.characters import CharacterFormat
from kit.process import PATIENCE
from kit.pty import VirtualPort


class User:
    def __init__(self):
        self.heard = b""
        self.losses = []

    def received(self, data, *, damaged=False):
        self.heard += data

    def lost(self, error):
        self.losses.append(error)


@pytest.fixture
def user():
    return User()


@pytest.fixture
def virtual(tmp_path):
    with VirtualPort(tmp_path / "adapter") as virtual:
        yield virtual


@asynccontextmanager
async def listening(virtual, user):
    open_port = make_opener(SerialSettings(str(virtual.path), 9600, CharacterFormat.parse("8E1"), listens=True))
    port = await open_port(user)
    try:
        yield port
    finally:
        port.close()
        await asyncio.wait_for(port.wait_closed(), PATIENCE)


async def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "not within the time"
        await asyncio.sleep(0.002)


def open_descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def modes(device):
    """How each descriptor of this process on a device may be used."""
    found = []
    for each in Path("/proc/self/fd").iterdir():
        if each.is_symlink() and str(each.readlink()) == device:
            flags = re.search(r"flags:\s*(\d+)", Path(f"/proc/self/fdinfo/{each.name}").read_text())
            found.append(int(flags[1], 8) & os.O_ACCMODE)
    return found


async def test_what_is_on_the_bus_is_heard_and_nothing_is_written(virtual, user):
    async with listening(virtual, user):
        virtual.write(b"\x03\x04ask")
        await until(lambda: user.heard == b"\x03\x04ask")
    assert virtual.read(1, timeout=0.1) == b""


async def test_its_descriptor_is_open_for_reading_only(virtual, user):
    before = modes(virtual.device)
    async with listening(virtual, user):
        opened = modes(virtual.device)
        for each in before:
            opened.remove(each)
        assert opened == [os.O_RDONLY]
    assert modes(virtual.device) == before


async def test_a_terminal_that_echoed_does_not_any_more(virtual, user):
    """Linux itself would send what was received, also from a descriptor that is open for reading only."""
    near_end = os.open(virtual.path, os.O_RDWR | os.O_NOCTTY)
    attributes = termios.tcgetattr(near_end)
    attributes[3] |= termios.ECHO | termios.ICANON
    attributes[0] |= termios.IXOFF
    termios.tcsetattr(near_end, termios.TCSANOW, attributes)
    async with listening(virtual, user):
        virtual.write(b"ask\n")
        await until(lambda: user.heard == b"ask\n")
        assert not termios.tcgetattr(near_end)[0] & termios.IXOFF
    os.close(near_end)
    assert virtual.read(1, timeout=0.1) == b""


async def test_it_refuses_to_write_and_to_change_its_rate(virtual, user):
    async with listening(virtual, user) as port:
        with pytest.raises(io.UnsupportedOperation):
            port.write(b"ask")
        with pytest.raises(io.UnsupportedOperation):
            port.change_baud(19200)
        assert virtual.baud == 9600
    assert virtual.read(1, timeout=0.1) == b""


async def test_a_port_that_another_program_has_locked_is_left_alone(virtual, user):
    near_end = os.open(virtual.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(near_end, fcntl.LOCK_EX)
    before = termios.tcgetattr(near_end)
    before[3] |= termios.ECHO  # what it would take away
    termios.tcsetattr(near_end, termios.TCSANOW, before)
    with pytest.raises(PortError, match="is held by another program"):
        async with listening(virtual, user):
            pass
    assert termios.tcgetattr(near_end) == before
    os.close(near_end)


async def test_nobody_else_takes_it(virtual, user):
    async with listening(virtual, user):
        with pytest.raises(PortError, match="is held by another program"):
            async with listening(virtual, User()):
                pass


async def test_an_absent_port(virtual, user):
    virtual.unplug()
    with pytest.raises(PortError, match="is the adapter plugged in"):
        async with listening(virtual, user):
            pass


async def test_it_tells_once_that_it_was_unplugged_and_leaves_nothing_open(virtual, user):
    before = open_descriptors()
    async with listening(virtual, user):
        virtual.unplug()
        await until(lambda: user.losses)
    assert len(user.losses) == 1
    assert "is gone" in str(user.losses[0])
    assert open_descriptors() == before - 2  # both ends are unplugged


async def test_it_tells_once_that_it_was_closed(virtual, user):
    async with listening(virtual, user):
        pass
    [loss] = user.losses
    assert isinstance(loss, PortClosed)


async def test_a_device_server_hears_nothing_from_it(user):
    sent = []

    async def serve(reader, writer):
        writer.write(b"\x03\x04ask")
        sent.append(await reader.read())
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        number = server.sockets[0].getsockname()[1]
        port = await make_opener(TcpSettings("rtu+tcp://bus", "127.0.0.1", number, listens=True))(user)
        await until(lambda: user.heard == b"\x03\x04ask")
        with pytest.raises(io.UnsupportedOperation):
            port.write(b"ask")
        port.close()
        await port.wait_closed()
        await until(lambda: sent)
    assert sent == [b""]
