"""The serial transport on real pseudo-terminals: what cannot be seen from outside, and its reconnector.

What any transport must do: test_serial_contract.py.
"""

import asyncio
import errno
import fcntl
import os
import subprocess
import sys
import termios
import threading
import time
from contextlib import asynccontextmanager, closing
from pathlib import Path

import pytest
from serial import SerialException

from gateway.errors import PortError
from gateway.events import LineLost, LineReopened, LineUp
from gateway.hardware.holders import _find_by_lock, find_holder
from gateway.hardware.ioctls import divide_clock
from gateway.ports import opener, opening
from gateway.ports import serial_transport as serial_transport_module
from gateway.ports.opener import open_serial
from gateway.ports.port import SerialSettings
from gateway.ports.reconnector import Reconnector
from gateway.timing.characters import CharacterFormat
from kit.patient_clock import PatientClock
from kit.process import PATIENCE
from kit.pty import VirtualPort

PARITY_FLAGS = termios.INPCK | termios.IGNPAR | termios.PARMRK


class User:
    """Notes what its port tells it, and when it was lost."""

    def __init__(self):
        self.heard = b""
        self.losses = []
        self.lost_at = None

    def received(self, data):
        self.heard += data

    def lost(self, error):
        self.losses.append(str(error))
        self.lost_at = time.monotonic()


class Owner:
    """A line that only notes."""

    def __init__(self):
        self.port = None
        self.heard = b""
        self.downs = 0

    def port_up(self, port):
        self.port = port

    def received(self, data):
        self.heard += data

    def port_ended(self, open_again, *, at_once):
        return False

    def port_down(self, error):
        self.port = None
        self.downs += 1


@pytest.fixture
def virtual(tmp_path):
    with VirtualPort(tmp_path / "adapter") as virtual:
        yield virtual


@pytest.fixture
def user():
    return User()


def settings(path, format_="8E1", baud=19200, **others):
    return SerialSettings(str(path), baud, CharacterFormat.parse(format_), **others)


@asynccontextmanager
async def opened(path, user, **kwargs):
    port = await open_serial(settings(path, **kwargs), user)
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


def descriptors():
    return set(Path("/proc/self/fd").iterdir())


# --- opening ---


@pytest.mark.parametrize(("format_", "expected"), [("8E1", termios.INPCK | termios.PARMRK), ("8N1", 0)])
async def test_a_port_with_parity_checks_it_at_every_rate(virtual, user, monkeypatch, format_, expected):
    """As far as a pseudo-terminal shows it; tests/qemu/uart.py sees a UART."""
    monkeypatch.setattr(opening, "VIRTUAL_MAJORS", ())
    monkeypatch.setattr(opening, "_check_format", lambda *_: None)
    with closing(Descriptor(virtual.path)) as beside:
        flags = termios.tcgetattr(beside.number)
        flags[0] |= termios.IGNPAR
        termios.tcsetattr(beside.number, termios.TCSANOW, flags)
        async with opened(virtual.path, user, format_=format_) as port:
            assert termios.tcgetattr(beside.number)[0] & PARITY_FLAGS == expected
            port.change_baud(14400)
            await until(lambda: virtual.baud == 14400)
            await until(lambda: termios.tcgetattr(beside.number)[0] & PARITY_FLAGS == expected)
            virtual.write(b"\xff\x00\xff\xff as they were sent")
            await until(lambda: user.heard == b"\xff\x00\xff\xff as they were sent")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (PermissionError(errno.EACCES, "no"), "no permission for .*: .* group "),
        (PermissionError(errno.EPERM, "no"), "allow it with DeviceAllow= in its unit"),
        (OSError(errno.EBUSY, "busy"), "is held by another program"),
        (OSError(errno.EIO, "io"), "has no hardware behind it"),
        (termios.error(errno.EINVAL, "invalid"), "does not support 8E1 at 19200 baud"),
        (ValueError("Failed to set custom baud rate"), "does not support 19200 baud"),
        (OSError(errno.EMFILE, "many"), "cannot be opened: Too many open files"),
    ],
)
async def test_reasons_are_in_an_operators_words(virtual, user, monkeypatch, error, reason):
    def fail(*args, **kwargs):
        raise error

    monkeypatch.setattr(opening, "ConfiguredOnce", fail)
    with pytest.raises(PortError, match=reason):
        await open_serial(settings(virtual.path), user)


async def test_an_adapter_that_sets_another_rate(virtual, user, monkeypatch):
    monkeypatch.setattr(opening, "read_baud", lambda descriptor: 13982)
    with pytest.raises(PortError, match="cannot do 14400 baud: its driver set 13982 instead"):
        await open_serial(settings(virtual.path, baud=14400), user)
    async with opened(virtual.path, user, baud=14000) as port:
        assert port.baud == 13982


async def test_a_rate_that_the_driver_refuses_later_is_a_loss_that_says_so(virtual, user, monkeypatch):
    """pyserial says it with a ValueError."""

    def refuse(*_):
        raise ValueError("Failed to set custom baud rate")

    async with opened(virtual.path, user) as port:
        monkeypatch.setattr(opening.ConfiguredOnce, "change_baud", refuse)
        port.change_baud(14400)
        await until(lambda: user.losses)
    assert user.losses == [f"{virtual.path} does not support 14400 baud: its driver knows standard rates only"]


async def test_a_uart_that_divides_its_clock_by_whole_numbers(virtual, user, monkeypatch):
    """Its driver repeats what it was asked for, or leaves the rate as it was."""
    monkeypatch.setattr(opening, "derive_divided_baud", lambda descriptor, baud: divide_clock(115_200, baud))
    async with opened(virtual.path, user, baud=5000) as port:
        assert port.baud == 5009
    with pytest.raises(PortError, match="cannot do 12345 baud: the nearest it can is 12800"):
        await open_serial(settings(virtual.path, baud=12345), user)
    monkeypatch.setattr(opening, "read_baud", lambda descriptor: 9600)
    with pytest.raises(PortError, match="cannot do 250000 baud: the nearest it can is 115200"):
        await open_serial(settings(virtual.path, baud=250_000), user)


async def test_a_rate_with_another_meaning(virtual, user, monkeypatch):
    monkeypatch.setattr(opening, "has_redefined_38400", lambda descriptor: True)
    with pytest.raises(PortError, match=r"38400 baud was given another meaning; setserial .* spd_normal undoes that"):
        await open_serial(settings(virtual.path, baud=38400), user)
    async with opened(virtual.path, user, baud=19200):
        pass


async def test_what_a_driver_did_before_is_restored_in_the_end(virtual, user, monkeypatch):
    restored = []
    monkeypatch.setattr(opening, "switch_rs485", lambda descriptor, *, on, delays: b"found" if on else None)
    monkeypatch.setattr(opening, "read_rs485_delays", lambda descriptor: (0, 0))
    monkeypatch.setattr(opening, "restore_rs485", lambda descriptor, found: restored.append(found))
    async with opened(virtual.path, user):
        pass
    assert restored == []
    sending = iter((True, True, False))
    monkeypatch.setattr(opening, "is_sending", lambda descriptor: next(sending))
    async with opened(virtual.path, user, rs485="kernel"):
        assert restored == []
    assert restored == [b"found"]
    assert list(sending) == []


async def test_what_a_driver_waits_before_and_after_sending_counts(virtual, user, monkeypatch):
    restored = []
    monkeypatch.setattr(opening, "switch_rs485", lambda descriptor, *, on, delays: b"found")
    monkeypatch.setattr(opening, "read_rs485_delays", lambda descriptor: (20, 10))
    monkeypatch.setattr(opening, "restore_rs485", lambda descriptor, found: restored.append(found))
    for delays in (None, (20, 10)):
        async with opened(virtual.path, user, rs485="kernel", latency=0.005, rs485_delay=delays) as port:
            assert port.latency == pytest.approx(0.035)
    restored.clear()
    with pytest.raises(PortError, match="cannot do rs485_delay 20 ms and 0 ms, it would keep 20 ms and 10 ms"):
        await open_serial(settings(virtual.path, rs485="kernel", rs485_delay=(20, 0)), user)
    assert restored == [b"found"]


async def test_a_driver_that_passes_over_the_format(virtual, user, monkeypatch):
    """Treated as a real port, a pseudo-terminal is just such a driver."""
    monkeypatch.setattr(opening, "VIRTUAL_MAJORS", ())
    with pytest.raises(PortError, match="cannot do 7E1: its driver set another format"):
        await open_serial(settings(virtual.path, format_="7E1"), user)


async def test_no_other_program_can_open_a_real_port(virtual, user, monkeypatch):
    monkeypatch.setattr(opening, "VIRTUAL_MAJORS", ())
    async with opened(virtual.path, user, format_="8N1") as port:
        assert exclusive(port._descriptor)
    with closing(Descriptor(virtual.path)) as again:
        assert not exclusive(again.number)


async def test_the_program_that_holds_a_port_is_named(virtual):
    script = "import fcntl, sys; port = open(sys.argv[1]); fcntl.flock(port, fcntl.LOCK_EX); print(); input()"
    other = await asyncio.create_subprocess_exec(
        sys.executable, "-c", script, virtual.path, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    await asyncio.wait_for(other.stdout.readline(), PATIENCE)
    name = Path(f"/proc/{other.pid}/comm").read_text().strip()  # noqa: ASYNC240 - procfs does not block
    assert find_holder(virtual.device) == f"{name} -c (pid {other.pid})"
    assert list(_find_by_lock(Path(virtual.device))) == [other.pid]
    await asyncio.wait_for(other.communicate(b"\n"), PATIENCE)
    assert find_holder(virtual.device) is None


class Descriptor:
    def __init__(self, path):
        self.number = os.open(path, os.O_RDWR | os.O_NOCTTY)

    def close(self):
        os.close(self.number)


def exclusive(descriptor):
    return int.from_bytes(fcntl.ioctl(descriptor, 0x80045440, bytes(4)), "little")  # TIOCGEXCL


# --- opening that takes its time ---


async def test_a_driver_that_hangs_at_open_holds_nobody_up(virtual, user, monkeypatch):
    release = threading.Event()
    open_device = opening.open_device

    def hang(*words):
        assert release.wait(PATIENCE)
        return open_device(*words)

    monkeypatch.setattr(opener, "open_device", hang)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(open_serial(settings(virtual.path), user), 0.05)
    with pytest.raises(PortError, match="hangs in an earlier attempt"):
        await open_serial(settings(virtual.path), user)
    before = descriptors()
    release.set()
    await until(lambda: str(virtual.path) not in opener._being_opened)
    await until(lambda: descriptors() <= before)  # what was opened for nobody is closed again
    async with opened(virtual.path, user):
        pass


# --- losing ---


@pytest.mark.parametrize(
    "error",
    [SerialException(errno.EIO, "lost"), OSError(errno.EIO, "lost"), termios.error(errno.EIO, "lost")],
    ids=["SerialException", "OSError", "termios.error"],
)
@pytest.mark.interpreted
@pytest.mark.parametrize("call", ["read", "write"])
async def test_each_way_in_which_a_driver_reports_a_vanished_device_is_a_loss(virtual, user, monkeypatch, error, call):
    async with opened(virtual.path, user) as port:
        await asyncio.sleep(0)
        with monkeypatch.context() as patch:
            patch.setattr(os, call, failing(call, port._descriptor, error))
            if call == "write":
                port.write(b"ask")
            else:
                virtual.write(b"answer")
            await until(lambda: user.losses)
    assert user.losses == [f"{virtual.path} is gone: Input/output error"]


def failing(name, broken, error):
    """The call of os with this name, which fails for one descriptor."""
    works = getattr(os, name)

    def call(descriptor, argument):
        if descriptor == broken:
            raise error
        return works(descriptor, argument)

    return call


async def test_a_driver_that_closes_slowly_does_not_block_the_loop(virtual, user, monkeypatch):
    loop_goes_on = threading.Event()

    def close_slowly(device, *, lost):
        assert loop_goes_on.wait(PATIENCE), "it waits for the driver"
        opening.close_device(device, lost=lost)

    monkeypatch.setattr(serial_transport_module, "close_device", close_slowly)
    port = await open_serial(settings(virtual.path), user)
    port.close()
    closed = asyncio.create_task(port.wait_closed(), name="wait_closed")
    await asyncio.sleep(0.1)
    assert not closed.done()
    loop_goes_on.set()
    await asyncio.wait_for(closed, PATIENCE)
    assert user.losses == ["closed"]


# --- kept open ---


@asynccontextmanager
async def kept(virtual):
    owner, events = Owner(), []
    reconnector = Reconnector(
        "hall-a", str(virtual.path), lambda user: open_serial(settings(virtual.path), user), owner, events.append
    )
    task = asyncio.create_task(reconnector.run(), name="reconnector")
    try:
        await asyncio.wait_for(reconnector.tried.wait(), PATIENCE)
        yield owner, events
    finally:
        task.cancel()
        await asyncio.wait([task])


async def test_a_replugged_adapter_is_used_again_under_its_new_name(virtual):
    async with kept(virtual) as (owner, events):
        before = virtual.device
        kept_name = os.open(before, os.O_RDWR | os.O_NOCTTY)
        virtual.unplug()
        with PatientClock() as clock:
            await until(lambda: owner.downs == 1)
            assert clock.seconds < 5
        await asyncio.sleep(1.5)
        virtual.plug()
        assert virtual.device != before
        with PatientClock() as clock:
            await until(lambda: owner.port)
            assert clock.seconds < 5
        owner.port.write(b"ask")
        assert virtual.read(3) == b"ask"
        virtual.write(b"answer")
        await until(lambda: owner.heard == b"answer")
        os.close(kept_name)
    assert [type(event) for event in events] == [LineUp, LineLost, LineReopened]
    assert (events[0].baud, events[2].baud) == (19200, 19200)


async def test_fifty_losses_leave_no_descriptor_and_no_thread_behind(virtual, monkeypatch):
    monkeypatch.setattr("gateway.ports.reconnector.FIRST_PAUSE", 0.002)
    monkeypatch.setattr("gateway.ports.reconnector.LONGEST_PAUSE", 0.002)
    before, threads = len(descriptors()), threading.active_count()
    async with kept(virtual) as (owner, events):
        for cycle in range(1, 51):
            await until(lambda: owner.port)
            virtual.unplug()
            await until(lambda cycle=cycle: owner.downs == cycle)
            virtual.plug()
        await until(lambda: owner.port)
    await until(lambda: threading.active_count() <= threads)
    assert len(descriptors()) == before
    assert sum(isinstance(event, LineReopened) for event in events) == 50


async def test_a_line_that_is_closed_can_be_opened_again_at_once(virtual):
    """As a reload does: the new reconnector starts when the old one has ended."""
    for _ in range(5):
        async with kept(virtual) as (owner, events):
            assert owner.port is not None
            assert [type(event) for event in events] == [LineUp]
