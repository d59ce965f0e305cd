"""A gateway inside a program: started and stopped many times, and in any thread, it leaves nothing behind."""

import asyncio
import faulthandler
import gc
import logging
import os
import resource
import signal
import subprocess
import sys
import threading
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from gateway import Gateway, LineDown
from gateway.modbus.rtu import encode
from kit.free_port import free_port
from kit.pki import client_context, listener
from kit.pty import VirtualPort
from kit.stepping_loop import descriptors

READ = bytes.fromhex("00 01 00 00 00 06 01 03 00 00 00 01")
RESPONSE = bytes.fromhex("00 01 00 00 00 05 01 03 02 00 07")
READ_IMAGE, RESPONSE_OF_IMAGE = READ[:6] + b"\x09" + READ[7:], RESPONSE[:6] + b"\x09" + RESPONSE[7:]
LINE = '[[line]]\nname = "hall"\nport = "{port}"\ntimeout = "2 s"\ndevices = [{{ unit = 1 }}]\n'
LISTEN = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n'


@pytest.fixture
def port(tmp_path):
    with VirtualPort(tmp_path / "port") as port:
        yield port


def answer(port: VirtualPort) -> None:
    """Answer each read at the far end of a line with 7."""
    with suppress(BlockingIOError):
        if os.read(port.far_end, 256):
            os.write(port.far_end, encode(1, bytes.fromhex("03 02 00 07")))


async def used(port: VirtualPort) -> None:
    """Run a gateway once: the program and a client read a register of a device."""
    loop = asyncio.get_running_loop()
    loop.add_reader(port.far_end, answer, port)
    try:
        async with Gateway.from_text(LINE.format(port=port.path) + LISTEN) as gateway:
            assert await read(gateway) == [7]
            assert await asks(gateway.addresses[0], READ) == RESPONSE
    finally:
        loop.remove_reader(port.far_end)


async def read(gateway: Gateway) -> list[int]:
    """Read a register; while the line is down, again: a process that is just being forked may have the port too."""
    async with asyncio.timeout(3.0):
        while True:
            try:
                return await gateway.unit(1).read_holding(0)
            except LineDown:
                await asyncio.sleep(0.05)


async def asks(address: str, request: bytes, **how: Any) -> bytes:
    """Connect as a client, ask, and return the response."""
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    reader, writer = await asyncio.open_connection(host, int(port), **how)
    writer.write(request)
    async with asyncio.timeout(10.0):
        response = await reader.readexactly(len(RESPONSE))
    writer.close()
    with suppress(OSError):
        await writer.wait_closed()
    return response


def objects() -> Counter[str]:
    """Count all objects by their types."""
    gc.collect()
    return Counter(type(each).__qualname__ for each in gc.get_objects())


@pytest.mark.parametrize("times", [30, pytest.param(300, marks=pytest.mark.search)])
def test_started_and_stopped_many_times_it_leaves_nothing(port, times):
    async def repeat() -> None:
        for _ in range(5):  # what is made once
            await used(port)
        before, opened = objects(), descriptors()
        for _ in range(times):
            await used(port)
            assert len(asyncio.all_tasks()) == 1
        await asyncio.sleep(3.0)  # timers that need not be cancelled
        assert descriptors() == opened
        assert threading.active_count() == threads
        grown = objects() - before
        assert {name: count for name, count in grown.items() if count >= times // 2} == {}

    threads = threading.active_count()
    asyncio.run(repeat())


def test_in_loops_of_several_threads_at_once(tmp_path):
    errors: list[BaseException] = []

    def live(number: int) -> None:
        try:
            with VirtualPort(tmp_path / f"port-{number}") as port:
                for _ in range(5):
                    asyncio.run(used(port))
        except BaseException as error:  # noqa: BLE001 - told below
            errors.append(error)

    threads = [threading.Thread(target=live, args=(number,)) for number in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join(60.0)
    assert errors == []


@pytest.mark.parametrize("hanging", ["open_device", "close_device"])
def test_a_driver_that_hangs_leaves_its_thread_and_nothing_else(port, hanging, monkeypatch):
    """`open_device` hangs before it has opened anything, `close_device` after the stop."""
    returns = threading.Event()
    module = "opener" if hanging == "open_device" else "serial_transport"
    call = getattr(sys.modules[f"gateway.ports.{module}"], hanging)

    def hang(*args: Any, **how: Any) -> Any:
        returns.wait(30.0)
        return call(*args, **how)

    async def live() -> None:
        loop = asyncio.get_running_loop()
        gateway = Gateway.from_text(LINE.format(port=port.path) + LISTEN)
        starting = asyncio.create_task(gateway.__aenter__())
        await asyncio.wait((starting,), timeout=0.5 if hanging == "open_device" else None)
        began = loop.time()
        if hanging == "open_device":
            starting.cancel()
            await asyncio.wait((starting,))
        else:
            await gateway.__aexit__(None, None, None)
        assert loop.time() - began < 4.0
        assert len(asyncio.all_tasks()) == 1

    before = descriptors()
    monkeypatch.setattr(f"gateway.ports.{module}.{hanging}", hang)
    asyncio.run(live())
    (left,) = [each for each in threading.enumerate() if each.name.endswith(str(port.path))]
    returns.set()  # long after the loop has ended
    left.join(10.0)
    assert not left.is_alive()
    assert descriptors() == before
    monkeypatch.undo()
    asyncio.run(used(port))


#: What a library may not change of the program that uses it.
SETTINGS: dict[str, Callable[[], Any]] = {
    "gc": lambda: (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count(), gc.callbacks[:]),
    "sys": lambda: (sys.getswitchinterval(), sys.excepthook, sys.unraisablehook, sys.stdout, sys.stderr),
    "signals": lambda: [signal.getsignal(each) for each in sorted(signal.valid_signals())],
    "wake-up": lambda: signal.set_wakeup_fd(-1),
    "mask": lambda: signal.pthread_sigmask(signal.SIG_BLOCK, ()),
    "faulthandler": faulthandler.is_enabled,
    "limits": lambda: {
        each: resource.getrlimit(getattr(resource, each)) for each in dir(resource) if each.startswith("RLIMIT_")
    },
    "warnings": lambda: warnings.filters[:],
    "logging": lambda: (logging.root.handlers[:], logging.root.level, logging.getLogger("gateway").handlers[:]),
    "factories": lambda: (logging.getLoggerClass(), logging.getLogRecordFactory(), logging.raiseExceptions),
    "environment": lambda: dict(os.environ),
    "folder": Path.cwd,
    "umask": lambda: os.umask(os.umask(0o022)),
    "nice": lambda: os.nice(0),
    "timer slack": lambda: Path("/proc/self/timerslack_ns").read_text(),
    "thread hooks": lambda: (threading.excepthook, threading.gettrace(), threading.getprofile()),
}


def everything(port: VirtualPort, web: int) -> str:
    """A config with a page, a TLS listener, a broker and a fleet that are not there, and a virtual unit."""
    return (
        'site = "plant"\n'
        + LINE.format(port=port.path).replace("unit = 1", 'unit = 1, name = "silo-1", profile = "weigher"')
        + '[[image]]\nunit = 240\nmap = [{ at = 0, device = "silo-1", holding = "0", every = "1 s" }]\n'
        + '[[image]]\nunit = 9\nholding = "0"\ninitial.holding = [{ at = 0, values = [7] }]\n'
        + LISTEN
        + listener()
        + f'[web]\nbind = "http://127.0.0.1:{web}"\n'
        + '[mqtt]\nbroker = "mqtt://127.0.0.1:1"\npublish = [{ device = "silo-1", every = "1 s" }]\n'
        + '[fleet]\nservers = ["nats://127.0.0.1:1"]\n'
    )


async def visited(port: VirtualPort, web: int) -> None:
    """Run a gateway with everything once: its page answers, and so does its TLS listener."""
    loop = asyncio.get_running_loop()
    loop.add_reader(port.far_end, answer, port)
    try:
        async with Gateway.from_text(everything(port, web)) as gateway:
            secured = gateway.addresses[1].removeprefix("tls://")
            assert await asks(secured, READ_IMAGE, ssl=client_context("operator")) == RESPONSE_OF_IMAGE
            reader, writer = await asyncio.open_connection("127.0.0.1", web)
            writer.write(b"GET /readyz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            assert (await reader.read()).startswith(b"HTTP/1.1 200")
            writer.close()
    finally:
        loop.remove_reader(port.far_end)


def test_settings_of_the_program_are_as_before(port):
    asyncio.run(visited(port, free_port()))
    before = {name: read() for name, read in SETTINGS.items()}
    during: dict[str, Any] = {}

    async def live() -> None:
        async with Gateway.from_text(everything(port, free_port())):
            during.update({name: read() for name, read in SETTINGS.items() if name != "wake-up"})

    asyncio.run(live())
    after = {name: read() for name, read in SETTINGS.items()}
    assert after == before
    own = ("wake-up", "signals")  # those of asyncio.run
    assert {name: each for name, each in during.items() if name not in own} == {
        name: each for name, each in before.items() if name not in own
    }


#: Runs a gateway with everything at the port and the address of the page that its arguments name.
PROGRAM = """
import asyncio, gc, sys
from pathlib import Path
sys.path[:0] = sys.argv[3:]
from test_embedded import visited
from kit.pty import VirtualPort
with VirtualPort(Path(sys.argv[1])) as port:
    asyncio.run(visited(port, int(sys.argv[2])), debug=True)
gc.collect()
"""


def test_in_development_mode_python_has_no_complaint(tmp_path):
    tests = Path(__file__).parents[1]
    words = [
        "-X",
        "dev",
        "-W",
        "error",
        "-c",
        PROGRAM,
        tmp_path / "port",
        str(free_port()),
        tests,
        Path(__file__).parent,
    ]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    complaints = ("Warning", "never", "destroyed", "unclosed", "Traceback", "Exception ignored", "non-thread-safe")
    assert [line for line in done.stderr.splitlines() if any(each in line for each in complaints)] == []
