"""What systemd hears of the service, and when it hears nothing. Real systemd: tests/system."""

import asyncio
import os
import socket
import time
from contextlib import suppress
from pathlib import Path

import pytest

from gateway.runtime.summary import summary
from gateway.service.systemd import Notifier, take_inherited_sockets
from gateway.service.watchdog import stuck, watch
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:5021"

[[line]]
name = "hall-a"
port = "/dev/hall-a"
devices = [{ unit = 1 }]
"""


@pytest.fixture
def systemd(tmp_path: Path):
    """Where systemd listens; `told()` gives what it has heard."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.setblocking(False)
        yield sock


def told(systemd: socket.socket) -> list[str]:
    heard = []
    while True:
        try:
            heard.append(systemd.recv(4096).decode())
        except BlockingIOError:
            return heard


def notifier(systemd: socket.socket, **environment: str) -> Notifier:
    return Notifier({"NOTIFY_SOCKET": systemd.getsockname(), **environment})


def test_it_hears_each_step(systemd: socket.socket) -> None:
    it = notifier(systemd)
    it.ready("1 of 1 lines up")
    asked = time.monotonic_ns() // 1000
    it.reloading()
    it.status("busy")
    it.alive()
    it.stopping()
    ready, status, reloading, *others = told(systemd)
    assert [ready, status, *others] == ["READY=1", "STATUS=1 of 1 lines up", "STATUS=busy", "WATCHDOG=1", "STOPPING=1"]
    step, _, began = reloading.partition("\nMONOTONIC_USEC=")
    assert step == "RELOADING=1"
    assert asked <= int(began) <= time.monotonic_ns() // 1000


def fill(systemd: socket.socket) -> None:
    """Others tell systemd so much that its queue is full."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other, suppress(BlockingIOError):
        other.setblocking(False)
        while True:
            other.sendto(b"X=1", systemd.getsockname())


@pytest.mark.parametrize("next_step", ["alive", "status"])
def test_a_step_that_it_had_no_room_for_is_told_before_what_comes_next(systemd: socket.socket, next_step: str) -> None:
    it = notifier(systemd)
    fill(systemd)
    it.reloading()
    it.ready("fine")
    assert set(told(systemd)) == {"X=1"}
    it.alive() if next_step == "alive" else it.status("later")
    it.alive()
    assert told(systemd) == ["READY=1", "WATCHDOG=1" if next_step == "alive" else "STATUS=later", "WATCHDOG=1"]


def test_without_systemd_nothing_happens(tmp_path: Path) -> None:
    Notifier({}).ready("fine")
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "nobody")}).ready("fine")


def test_an_abstract_socket_is_found() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(f"\0mbgw-test-{os.getpid()}")
        sock.setblocking(False)
        Notifier({"NOTIFY_SOCKET": f"@mbgw-test-{os.getpid()}"}).alive()
        assert told(sock) == ["WATCHDOG=1"]


@pytest.mark.parametrize(
    ("environment", "period"),
    [
        ({}, 0.0),
        ({"WATCHDOG_USEC": "30000000"}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": str(os.getpid())}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "1"}, 0.0),
    ],
)
def test_signs_of_life_are_wanted_from_the_process_that_is_named(environment: dict[str, str], period: float) -> None:
    assert Notifier(environment).watchdog == period


def test_sockets_for_another_process_are_not_ours() -> None:
    assert take_inherited_sockets({}) == []
    assert take_inherited_sockets({"LISTEN_PID": "1", "LISTEN_FDS": "1"}) == []


class Watched:
    """A gateway under the eye of systemd, as `watch` wants it."""

    def __init__(self, gateway) -> None:
        self.gateway = gateway


@pytest.mark.interpreted
async def test_a_loop_that_is_late_and_a_line_that_is_stuck_give_no_sign_of_life(systemd: socket.socket) -> None:
    async with gateway_bench(CONFIG) as bench:
        watching = asyncio.create_task(watch(Watched(bench.gateway), notifier(systemd, WATCHDOG_USEC="3000000")))
        await asyncio.sleep(3.5)
        assert [text for text in told(systemd) if text == "WATCHDOG=1"] == ["WATCHDOG=1"] * 3
        bench.gateway.lines[0].driver.overdue = lambda now: 1.5
        await asyncio.sleep(3.0)
        assert "WATCHDOG=1" not in told(systemd)
        watching.cancel()


async def test_a_line_is_stuck_when_nobody_wakes_it() -> None:
    async with gateway_bench(CONFIG) as bench:
        loop = asyncio.get_running_loop()
        bench.client().ask(1, "03 00 00 00 01")
        bench.gateway.lines[0].driver.close()  # its alarm
        assert stuck(bench.gateway, loop.time()) == []
        await asyncio.sleep(10.0)
        assert stuck(bench.gateway, loop.time()) == ["hall-a"]


async def test_the_status_text_says_which_line_is_down() -> None:
    async with gateway_bench(CONFIG) as bench:
        assert summary(bench.gateway) == "1 of 1 lines up, 0 clients"
        bench.lines["hall-a"].pull()
        await asyncio.sleep(0.01)
        assert summary(bench.gateway).startswith("0 of 1 lines up, 0 clients; hall-a: ")


@pytest.mark.parametrize("period", ["0", "10000000"])
async def test_the_status_text_follows_within_a_second(systemd: socket.socket, period: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        watching = asyncio.create_task(watch(Watched(bench.gateway), notifier(systemd, WATCHDOG_USEC=period)))
        bench.lines["hall-a"].pull()
        await asyncio.sleep(1.1)
        assert told(systemd)[-1].startswith("STATUS=0 of 1 lines up")
        watching.cancel()


async def test_a_line_that_was_not_tried_is_not_up() -> None:
    assert summary(GatewayBench(CONFIG).gateway) == "0 of 1 lines up, 0 clients; hall-a: not tried yet"


async def test_the_status_text_of_many_lines_is_short_enough_for_systemd() -> None:
    line = '[[line]]\nport = "/dev/serial/by-id/{0}-{1}"\ndevices = [{{ unit = {1} }}]\n'
    gateway = GatewayBench("".join(line.format("x" * 80, unit) for unit in range(1, 101))).gateway
    text = summary(gateway)
    assert text.startswith(f"0 of 100 lines up, 0 clients; {'x' * 80}-1: not tried yet; ")
    shown = text.count("not tried yet")
    assert text.endswith(f"; and {100 - shown} more")
    assert 900 < len(text) < 1100
