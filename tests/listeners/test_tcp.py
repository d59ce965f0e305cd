"""What a TCP listener does at regular times, in virtual time."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.events import Event
from gateway.listeners.sessions.arrivals import LOOK_STEP
from gateway.listeners.settings import ListenSettings
from gateway.listeners.tcp import SWEEP_STEP, TcpListener
from gateway.request import Caller
from gateway.timing.measured import NEVER
from kit.router import router


class Connection(SimpleNamespace):
    """One that counts what its listener does with it."""

    def __init__(self) -> None:
        super().__init__(caller=Caller("10.0.0.9:1", "10.0.0.9", "10.0.0.9"), role=None)
        self.is_idle, self.last_asked = True, NEVER
        self.looks = self.checks = self.aborts = 0

    def look(self) -> None:
        self.looks += 1

    def check_client(self, now: float, idle: float) -> None:
        self.checks += 1

    def abort(self, reason: str = "") -> None:
        self.aborts += 1

    __hash__ = object.__hash__


def started(scheme: str) -> Any:
    """A listener without sockets."""
    events: list[Event] = []
    listener = TcpListener(ListenSettings("scada", "", 502, scheme=scheme), router({}, events.append), events.append)
    listener.start()
    return listener


async def test_clients_that_keep_connecting_do_not_put_the_next_look_off() -> None:
    listener, first = started("rtu+tcp"), Connection()
    listener.connected(first)
    for _ in range(100):
        listener.connected(Connection())
        await asyncio.sleep(LOOK_STEP / 2)
    listener.close()
    assert 40 <= first.looks <= 50


async def test_looking_ends_when_nobody_is_left_and_begins_again() -> None:
    listener = started("ascii+tcp")
    for _ in range(2):
        connection = Connection()
        listener.connected(connection)
        await asyncio.sleep(2.5 * LOOK_STEP)
        listener.closed(connection, "")
        await asyncio.sleep(10 * LOOK_STEP)
        assert connection.looks == 2
    listener.close()


@pytest.mark.parametrize("scheme", ["tcp", "rtu+tcp"])
async def test_clients_are_checked_at_regular_times_until_the_listener_closes(scheme: str) -> None:
    listener, connection = started(scheme), Connection()
    listener.connected(connection)
    await asyncio.sleep(4.5 * SWEEP_STEP)
    assert (connection.checks, connection.looks > 0) == (4, scheme == "rtu+tcp")
    listener.close()
    looks = connection.looks
    await asyncio.sleep(4 * SWEEP_STEP)
    assert (connection.checks, connection.looks, connection.aborts) == (4, looks, 1)


async def test_a_listener_without_clients_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A control room has hundreds of them."""
    timers: list[object] = []
    loop = asyncio.get_running_loop()
    call_later = loop.call_later

    def count(delay: float, call: Any, *arguments: Any) -> Any:
        timers.append(call)
        return call_later(delay, call, *arguments)

    monkeypatch.setattr(loop, "call_later", count)
    listener, connection = started("tcp"), Connection()
    for client in (None, connection, None):
        if client is not None:
            listener.connected(client)
            await asyncio.sleep(4.5 * SWEEP_STEP)
            listener.closed(client, "")
            await asyncio.sleep(2 * SWEEP_STEP)
            timers.clear()
        await asyncio.sleep(10 * SWEEP_STEP)
        assert not [each for each in timers if "sweep" in repr(each)]
    assert connection.checks == 4
    listener.close()


async def test_one_that_is_closing_for_too_long_is_aborted() -> None:
    listener, connection = started("tcp"), Connection()
    listener.connected(connection)
    listener.closing(connection)
    await asyncio.sleep(2.0 - SWEEP_STEP)
    assert (connection.aborts, connection.checks) == (0, 0)
    await asyncio.sleep(2 * SWEEP_STEP)
    assert connection.aborts > 0
