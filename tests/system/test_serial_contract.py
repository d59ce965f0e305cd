"""What any transport behind `gateway.ports.port` must do on a serial port, seen from outside, on pseudo-terminals.

One that is to take the place of the present one is added to TRANSPORTS, and must pass all of this; what only a UART
shows (formats, parity, RS-485, the rate of the hardware) is seen by tests/qemu/uart.py.
Why: docs/adr/0015-serial-transport.md.
"""

import array
import asyncio
import fcntl
import os
import termios
import threading
import time
from contextlib import asynccontextmanager, contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.errors import PortClosed, PortError
from gateway.ports.opener import open_serial
from gateway.ports.port import SerialSettings
from gateway.timing.characters import CharacterFormat
from kit.patient_clock import PatientClock
from kit.process import PATIENCE
from kit.pty import VirtualPort

TRANSPORTS = {"pyserial-asyncio": open_serial}
#: What happens by itself takes less, in seconds of a patient clock.
AT_ONCE = 2.0
#: What a port that is closed takes at most when its driver takes nothing any more, in such seconds.
CLOSED_WITHIN = 5.0
#: More than a terminal takes while nobody reads it, in bytes; a port keeps that much, and much more is a loss.
A_LOT = 20 * 1024
FAR_TOO_MUCH = 128 * 1024
#: What a terminal keeps at most, and how much of it a port hands over before others have their turn, in bytes.
IN_A_TERMINAL = 4096
MOST_IN_A_TURN = 1024


class User:
    """Notes what its port tells it, and in what it was told."""

    def __init__(self):
        self.heard = b""
        self.losses = []
        self.calling = ""
        self.lost_in = None
        self.hears = lambda: None

    def received(self, data, *, damaged=False):
        assert not damaged
        self.heard += data
        self.hears()

    def lost(self, error):
        self.losses.append(error)
        self.lost_in = self.calling

    @contextmanager
    def during(self, call):
        self.calling = call
        yield
        self.calling = ""


@pytest.fixture(params=TRANSPORTS.values(), ids=TRANSPORTS)
def transport(request):
    return request.param


@pytest.fixture
def virtual(tmp_path):
    with VirtualPort(tmp_path / "adapter") as virtual:
        yield virtual


@pytest.fixture
def user():
    return User()


@pytest.fixture
def opened(transport, virtual, user):
    """Opens the port for `user`, with other settings if need be; it is closed in the end."""

    @asynccontextmanager
    async def opened(format_="8E1", baud=19200, **others):
        port = await transport(settings(virtual.path, format_, baud, **others), user)
        try:
            yield port
        finally:
            port.close()
            await asyncio.wait_for(port.wait_closed(), PATIENCE)

    return opened


def settings(path, format_="8E1", baud=19200, **others):
    return SerialSettings(str(path), baud, CharacterFormat.parse(format_), **others)


async def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "not within the time"
        await asyncio.sleep(0.002)


async def why_not(transport, settings, user):
    with pytest.raises(PortError) as raised:
        await transport(settings, user)
    return str(raised.value)


def descriptors():
    return set(Path("/proc/self/fd").iterdir())


def bytes_to_read(path):
    """What waits with the driver of a terminal."""
    near_end = os.open(path, os.O_RDWR | os.O_NOCTTY)
    count = array.array("i", [0])
    fcntl.ioctl(near_end, termios.FIONREAD, count)
    os.close(near_end)
    return count[0]


def arrived(virtual, size):
    """Wait, while the loop stands still, until so much can be read."""
    deadline = time.monotonic() + PATIENCE
    while bytes_to_read(virtual.path) < size:
        assert time.monotonic() < deadline, "not within the time"
        time.sleep(0.001)


async def longest_turn(clock, condition):
    """Wait for a condition; the longest time that the loop was held up meanwhile, in seconds of this clock."""
    longest, turn = 0.0, clock.seconds
    while not condition():
        await asyncio.sleep(0.001)
        now = clock.seconds
        longest, turn = max(longest, now - turn), now
    return longest


# --- opening ---


@pytest.mark.parametrize("format_", ["8E1", "7E1", "8O1", "7O1", "8N1", "8N2", "7E2", "7N2"])
async def test_every_format_can_be_opened_twice(opened, virtual, user, format_):
    """A pseudo-terminal takes parity or 7 bits once, and refuses to be configured ever after."""
    for _ in range(2):
        async with opened(format_) as port:
            port.write(b"\xff\x80ask")
            assert virtual.read(5) == b"\xff\x80ask"
            virtual.write(b"\x9aanswer")
            await until(lambda: user.heard == b"\x9aanswer")
        user.heard = b""


@pytest.mark.parametrize("baud", [300, 1200, 14400, 19200, 38400, 115200, 123456])
async def test_any_rate_is_set(opened, virtual, baud):
    async with opened(baud=baud) as port:
        assert (virtual.baud, port.baud) == (baud, baud)


async def test_every_byte_goes_through_unchanged_both_ways(opened, virtual, user):
    """No line discipline translates, echoes or interprets: CR, NL, XON, XOFF, EOF, INTR."""
    everything = bytes(range(256))
    async with opened() as port:
        port.write(everything)
        assert virtual.read(256) == everything
        virtual.write(everything)
        await until(lambda: len(user.heard) == 256)
        assert user.heard == everything
        assert virtual.read(1, timeout=0.05) == b""


async def test_what_was_there_before_is_discarded(opened, virtual, user):
    virtual.write(b"stale")
    async with opened():
        virtual.write(b"fresh")
        await until(lambda: user.heard)
    assert user.heard == b"fresh"


async def test_nothing_is_received_before_the_opener_has_its_port(transport, virtual, user):
    """While somebody else talks on the line all the time."""
    has_ended = threading.Event()

    def talk():
        while not has_ended.wait(0.001):
            virtual.write(b"?")

    talking = threading.Thread(target=talk, name="talk")
    talking.start()
    try:
        port = await transport(settings(virtual.path), user)
        assert user.heard == b""
        await until(lambda: user.heard)
        port.close()
        await asyncio.wait_for(port.wait_closed(), PATIENCE)
    finally:
        has_ended.set()
        talking.join()


async def test_a_break_discards_nothing_whatever_was_set_before(opened, virtual):
    before = os.open(virtual.path, os.O_RDWR | os.O_NOCTTY)
    attributes = termios.tcgetattr(before)
    attributes[0] |= termios.BRKINT
    termios.tcsetattr(before, termios.TCSANOW, attributes)
    async with opened(baud=14400):
        assert not termios.tcgetattr(before)[0] & termios.BRKINT
        assert virtual.baud == 14400
    os.close(before)


async def test_it_says_that_it_is_virtual_and_no_connection_and_how_late_it_may_be(opened):
    async with opened() as port:
        assert (port.is_virtual, port.has_arrived) == (True, None)
        assert 0 < port.latency < 0.02
    async with opened(latency=0.25) as port:
        assert port.latency == 0.25


async def test_an_absent_port(transport, tmp_path, user):
    said = await why_not(transport, settings(tmp_path / "adapter"), user)
    assert said.endswith("adapter does not exist: is the adapter plugged in?")


@pytest.mark.parametrize("path", ["/dev/null", "/etc/passwd", "/tmp"])
async def test_something_that_is_no_serial_port(transport, path, user):
    assert await why_not(transport, settings(path), user) == f"{path} is not a serial port"


async def test_an_opening_that_is_given_up_leaves_nothing_open(transport, virtual, user):
    before = descriptors()
    opening = asyncio.create_task(transport(settings(virtual.path), user), name="open")
    await asyncio.sleep(0)
    opening.cancel()
    await asyncio.wait([opening])
    assert opening.cancelled()
    await until(lambda: descriptors() <= before)
    assert user.losses == []


# --- exclusive access, RS-485 ---


async def test_a_port_is_open_for_one(transport, opened, virtual):
    async with opened():
        assert "is held by another program" in await why_not(transport, settings(virtual.path), User())
    async with opened():
        pass


async def test_a_port_that_another_program_has_locked_is_left_alone(transport, virtual, user):
    other = os.open(virtual.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(other, fcntl.LOCK_EX)
    baud = virtual.baud
    assert "is held by another program" in await why_not(transport, settings(virtual.path, baud=1200), user)
    assert virtual.baud == baud
    os.close(other)


async def test_a_driver_without_rs485(transport, virtual, user):
    before = descriptors()
    said = await why_not(transport, settings(virtual.path, rs485="kernel"), user)
    assert said.endswith('has no RS-485 support in its driver; use rs485 = "adapter"')
    assert descriptors() <= before


# --- handing over ---


async def test_a_paused_port_hands_over_nothing_until_somebody_looks(opened, virtual, user):
    async with opened() as port:
        virtual.write(b"1")
        await until(lambda: user.heard == b"1")
        assert port.pause()
        virtual.write(b"2")
        await asyncio.sleep(0.05)
        assert user.heard == b"1"
        port.read_now()
        assert user.heard == b"12"
        virtual.write(b"3")
        await until(lambda: user.heard == b"123")


async def test_who_looks_hears_all_that_has_come(opened, virtual, user):
    async with opened() as port:
        virtual.write(bytes(2000))
        virtual.write(bytes(1000))
        arrived(virtual, 3000)
        port.read_now()
        assert len(user.heard) == 3000


async def test_who_looks_at_a_port_with_nothing_to_read_hears_nothing(opened, user):
    async with opened() as port:
        port.read_now()
        assert (user.heard, user.losses) == (b"", [])


async def test_an_idle_port_is_not_taken_for_one_that_hung_up(opened, virtual, user):
    async with opened() as port:
        for _ in range(3):
            port.pause()
            port.read_now()
            await asyncio.sleep(0.02)
        assert user.losses == []
        virtual.write(b"still there")
        await until(lambda: user.heard == b"still there")


async def test_a_port_from_which_much_comes_leaves_others_their_turn(opened, virtual, user):
    async with opened():
        await asyncio.sleep(0)
        virtual.write(bytes(3000))
        arrived(virtual, 3000)
        heard = [0]
        while heard[-1] < 3000:
            await asyncio.sleep(0)
            heard.append(len(user.heard))
        assert max(after - before for before, after in pairwise(heard)) <= MOST_IN_A_TURN


async def test_a_user_who_pauses_a_port_hears_no_more_of_what_has_come(opened, virtual, user):
    async with opened() as port:
        user.hears = port.pause
        virtual.write(bytes(3000))
        arrived(virtual, 3000)
        await until(lambda: user.heard)
        await asyncio.sleep(0.02)
        assert len(user.heard) < MOST_IN_A_TURN
        port.read_now()
        assert len(user.heard) == 3000


async def test_who_looks_at_a_port_that_never_runs_dry_comes_back(opened, virtual, user):
    def goes_on():
        if len(user.heard) < 16 * IN_A_TERMINAL:
            virtual.write(bytes(256))
            arrived(virtual, 256)

    async with opened() as port:
        port.pause()
        virtual.write(bytes(256))
        goes_on()
        user.hears = goes_on
        port.read_now()
        assert len(user.heard) <= IN_A_TERMINAL
        user.hears = port.pause


# --- changing the rate ---


async def test_the_rate_changes_and_nothing_else_does(opened, virtual, user):
    async with opened() as port:
        attributes = termios.tcgetattr(virtual.far_end)[:4]
        port.change_baud(14400)
        await until(lambda: virtual.baud == 14400)
        same = ~(termios.CBAUD if hasattr(termios, "CBAUD") else 0o010017)
        changed = termios.tcgetattr(virtual.far_end)[:4]
        assert [*changed[:2], changed[2] & same, changed[3]] == [*attributes[:2], attributes[2] & same, attributes[3]]
        port.write(b"ask")
        assert virtual.read(3) == b"ask"
        virtual.write(b"answer")
        await until(lambda: user.heard == b"answer")


async def test_a_rate_that_cannot_be_set_any_more_is_a_loss(opened, virtual, user):
    async with opened() as port:
        virtual.unplug()
        port.change_baud(14400)
        await until(lambda: user.losses)
    assert len(user.losses) == 1


# --- losing ---


async def test_unplugging_is_told_once_and_at_once(opened, virtual, user):
    async with opened() as port:
        with PatientClock() as clock:
            virtual.unplug()
            await until(lambda: user.losses)
            assert clock.seconds < AT_ONCE
        port.write(b"into the void")
        port.read_now()
        port.close()
        await port.wait_closed()
    assert [str(loss) for loss in user.losses] == [f"{virtual.path} is gone: unplugged, or its driver has closed it"]


@pytest.mark.parametrize("call", ["write", "look"])
async def test_unplugging_is_told_once_to_who_is_using_the_port_and_never_inside_a_call(opened, virtual, user, call):
    async with opened() as port:
        port.pause()
        virtual.unplug()
        with user.during(call):
            if call == "write":
                port.write(b"ask")
            else:
                port.read_now()
        await until(lambda: user.losses)
        await asyncio.sleep(0.05)
        assert (len(user.losses), user.lost_in) == (1, "")


async def test_a_port_that_is_plugged_in_again_can_be_opened_while_the_lost_one_is_let_go(transport, virtual, user):
    lost = await transport(settings(virtual.path), user)
    virtual.unplug()
    await until(lambda: user.losses)
    virtual.plug()
    found = await transport(settings(virtual.path), User())
    found.write(b"ask")
    assert virtual.read(3) == b"ask"
    found.close()
    await asyncio.wait_for(asyncio.gather(lost.wait_closed(), found.wait_closed()), PATIENCE)


# --- back-pressure ---


async def test_more_than_the_driver_takes_is_sent_in_order(opened, virtual, user):
    data = bytes(range(256)) * (A_LOT // 256)
    async with opened() as port:
        port.write(data)
        port.write(b"the end")
        received = b""
        deadline = time.monotonic() + PATIENCE
        while not received.endswith(b"the end"):
            assert time.monotonic() < deadline, "not within the time"
            await asyncio.sleep(0.001)
            received += virtual.read(1000, timeout=0)
        assert received == data + b"the end"
        assert user.losses == []


async def test_a_port_that_takes_nothing_any_more_is_lost_before_much_is_kept(opened, virtual, user):
    async with opened() as port:
        with user.during("write"):
            for _ in range(FAR_TOO_MUCH // 1024):
                port.write(bytes(1024))
        await until(lambda: user.losses)
        assert user.lost_in == ""
        port.write(b"ignored")
    assert [str(loss) for loss in user.losses] == [f"{virtual.path} takes no more data"]


# --- closing ---


async def test_closing_is_told_once(opened, user):
    async with opened() as port:
        with user.during("close"):
            port.close()
            port.close()
        await until(lambda: user.losses)
    assert user.lost_in == ""
    assert [type(loss) for loss in user.losses] == [PortClosed]


async def test_a_paused_port_can_be_closed(opened, user):
    before = descriptors()
    async with opened() as port:
        port.pause()
    assert [type(loss) for loss in user.losses] == [PortClosed]
    assert descriptors() <= before


async def test_a_port_that_is_closed_hands_over_and_sends_nothing_more(opened, virtual, user):
    async with opened() as port:
        port.close()
        port.write(b"ask")
        virtual.write(b"answer")
        port.read_now()
        await asyncio.sleep(0.05)
    assert user.heard == b""
    assert virtual.read(1, timeout=0.05) == b""


async def test_what_was_written_is_sent_before_the_port_closes(opened, virtual, user):
    async with opened() as port:
        port.write(bytes(A_LOT) + b"the end")
        port.close()
        received = b""
        deadline = time.monotonic() + PATIENCE
        while not received.endswith(b"the end"):
            assert time.monotonic() < deadline, "not within the time"
            await asyncio.sleep(0.001)
            received += virtual.read(65536, timeout=0)
    assert len(received) == A_LOT + len(b"the end")
    await asyncio.sleep(CLOSED_WITHIN / 2)  # no deadline for what was sent comes to tell it again
    assert [type(loss) for loss in user.losses] == [PortClosed]


async def test_a_port_that_takes_nothing_closes_all_the_same_and_holds_up_nobody(transport, virtual, user):
    port = await transport(settings(virtual.path), user)
    port.write(bytes(A_LOT))
    with PatientClock() as clock:
        port.close()
        assert clock.seconds < AT_ONCE
        closing = asyncio.create_task(port.wait_closed(), name="wait_closed")
        assert await asyncio.wait_for(longest_turn(clock, closing.done), PATIENCE) < AT_ONCE
        assert clock.seconds < CLOSED_WITHIN
    assert len(user.losses) == 1


async def test_nothing_is_left_behind(opened, virtual, user):
    before, threads = descriptors(), threading.active_count()
    for _ in range(20):
        async with opened() as port:
            port.write(b"ask")
    for _ in range(20):
        async with opened():
            virtual.unplug()
            await until(lambda: user.losses)
        virtual.plug()
        user.losses.clear()
    await until(lambda: threading.active_count() <= threads)
    assert descriptors() <= before
