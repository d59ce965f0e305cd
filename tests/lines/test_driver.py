"""A line on the clock and a port: it wakes by itself, and a defect in it stays in it."""

import asyncio
from collections.abc import Callable
from dataclasses import replace

import pytest

from gateway.devices.device import Device, EveryDevice
from gateway.errors import PortError
from gateway.events import ConnectionRenewed, Event, PartFailed
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from gateway.lines.settings import LineSettings
from gateway.lines.transaction import Transaction
from kit.asker import Asker
from kit.line_bench import READ, READ_FRAME, RESPONSE, RESPONSE_FRAME, SETTINGS, Bench, is_empty


class FakePort:
    latency = 0.005
    is_virtual = True
    has_arrived = None

    def __init__(self) -> None:
        self.written: list[str] = []
        self.unread = ""
        self.received: Callable[[bytes], None]
        self.closed = False

    def read_now(self) -> None:
        data, self.unread = self.unread, ""
        if data:
            self.received(bytes.fromhex(data))

    def write(self, data: bytes) -> None:
        self.written.append(data.hex(" ").upper())

    def change_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        self.closed = True


class Driven:
    """A driver with an open port and one device."""

    def __init__(self, settings: LineSettings = SETTINGS) -> None:
        self.loop = asyncio.get_running_loop()
        self.events: list[Event] = []
        self.line = Line(settings, self.events.append)
        self.rates: list[int] = []
        self.driver = LineDriver(self.line, self.loop, self.events.append, self.rates.append)
        self.port = FakePort()
        self.port.received = self.driver.received
        self.driver.port_up(self.port)
        self.client = Asker()
        self.device = Device(Bench().device().settings, self.driver)

    def ask(self, pdu: str = READ) -> None:
        now = self.loop.time()
        self.device.submit(self.client.ask(pdu, now=now), now)


async def test_it_waits_for_the_silence_and_sends() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.1)
    assert driven.port.written == [READ_FRAME]
    driven.driver.received(bytes.fromhex(RESPONSE_FRAME))
    assert driven.client.answers == [RESPONSE]
    driven.driver.close()


async def test_what_stood_unread_when_an_idle_line_was_asked_is_no_answer_and_silence_follows_it() -> None:
    driven = Driven()
    await asyncio.sleep(1.0)
    driven.port.unread = RESPONSE_FRAME
    driven.ask()
    assert driven.port.written == []
    await asyncio.sleep(SETTINGS.silence_before_request)
    assert driven.port.written == [READ_FRAME]
    assert driven.client.answers == []
    driven.driver.close()


async def test_what_stands_unread_when_a_silence_has_passed_begins_another_one() -> None:
    driven = Driven()
    await asyncio.sleep(1.0)
    driven.driver.received(b"\x00")
    driven.ask()
    driven.port.unread = RESPONSE_FRAME
    await asyncio.sleep(1.5 * SETTINGS.silence_before_request)
    assert driven.port.written == []
    await asyncio.sleep(0.5 * SETTINGS.silence_before_request)
    assert driven.port.written == [READ_FRAME]
    assert driven.client.answers == []
    driven.driver.close()


async def test_an_answer_that_stands_unread_when_the_limit_passes_is_in_time() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.1)
    driven.port.unread = RESPONSE_FRAME
    await asyncio.sleep(0.3)
    assert driven.client.answers == [RESPONSE]
    driven.driver.close()


async def test_while_a_request_is_on_the_line_nobody_looks_for_the_next_one() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.1)
    driven.port.unread = RESPONSE_FRAME
    driven.ask("03 00 10 00 02")
    assert driven.port.unread
    driven.driver.close()


@pytest.mark.parametrize("virtual", [True, False])
async def test_a_line_is_virtual_while_its_port_is_open_and_says_so(virtual: bool) -> None:
    driven = Driven()
    driven.port.is_virtual = virtual
    assert driven.driver.is_virtual == virtual
    driven.driver.port_down(PortError("pulled"))
    assert not driven.driver.is_virtual
    driven.driver.close()


async def test_it_answers_0b_when_the_limit_has_passed() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.3)
    assert driven.client.answers == ["83 0B"]
    driven.driver.close()


async def test_a_lost_port_fails_what_is_under_way() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.01)
    driven.driver.port_down(PortError("pulled"))
    assert driven.client.answers == ["83 0B"]
    driven.driver.close()


async def test_a_change_of_rate_reaches_line_port_and_whoever_opens_the_port_next() -> None:
    driven = Driven()
    driven.driver.change_rate(9600)
    assert driven.line.settings.timing.baud == driven.port.baud == 9600
    assert driven.rates == [9600]
    driven.driver.close()


@pytest.mark.interpreted
async def test_a_defect_ends_at_the_error_boundary_requests_fail_and_the_port_is_reopened() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.01)

    def defect(data: bytes, now: float, *, damaged: bool) -> None:
        raise ZeroDivisionError

    driven.line.received = defect  # type: ignore[method-assign]
    driven.driver.received(b"\x01")
    assert driven.client.answers == ["83 0B"]
    assert driven.port.closed
    assert isinstance(driven.events[0], PartFailed)
    assert "ZeroDivisionError" in driven.events[0].traceback
    driven.driver.close()


def defect(*_: object) -> None:
    raise ZeroDivisionError


class Unanswerable:
    """An answer time that cannot be worked out."""

    slowest = 0.0
    allowed = staticmethod(defect)


async def three_clients(driven: Driven) -> list[Asker]:
    """One request on the line, two that wait, a broadcast behind them; all of different clients."""
    clients = [Asker(f"10.0.0.{number}:1") for number in range(4)]
    await asyncio.sleep(0.1)
    now = driven.loop.time()
    for client, pdu in zip(clients, [READ, "06 00 01 00 05", "04 00 10 00 01"], strict=False):
        driven.device.submit(client.ask(pdu, now=now), now)
    EveryDevice(driven.driver).submit(clients[3].ask("06 00 01 00 05", unit=0, now=now), now)
    return clients


@pytest.mark.interpreted
async def test_a_second_defect_while_the_first_is_dealt_with_ends_at_the_error_boundary_too() -> None:
    driven = Driven()
    clients = await three_clients(driven)
    driven.line._receiver.received = defect  # type: ignore[method-assign]
    driven.line.observer = defect
    driven.driver.received(bytes.fromhex(RESPONSE_FRAME))
    assert driven.port.closed
    assert [type(event) for event in driven.events].count(PartFailed) == 2
    assert [len(client.answers) for client in clients] == [1] * 4
    driven.driver.close()


@pytest.mark.interpreted
@pytest.mark.parametrize("where", ["encode", "write", "finished", "observer"])
async def test_a_defect_loses_no_request_each_gets_exactly_one_answer(where: str) -> None:
    driven = Driven()
    clients = await three_clients(driven)
    assert driven.port.written == [READ_FRAME]
    if where == "encode":
        driven.line._receiver._scanner.encode = defect
    elif where == "write":
        driven.line._write = defect
    elif where == "finished":
        driven.device.finished = defect  # type: ignore[method-assign]
    else:
        driven.line.observer = defect
    driven.driver.received(bytes.fromhex(RESPONSE_FRAME))
    await asyncio.sleep(0.5)
    assert clients[0].answers == [RESPONSE]
    assert [len(client.answers) for client in clients] == [1, 1, 1, 1]
    assert isinstance(driven.events[0], PartFailed)
    assert driven.port.closed
    assert is_empty(driven.line)
    driven.driver.close()


@pytest.mark.interpreted
@pytest.mark.parametrize("where", ["encode", "write"])
async def test_a_defect_while_a_broadcast_leaves_ends_it_once(where: str) -> None:
    driven = Driven()
    await asyncio.sleep(0.1)
    if where == "encode":
        driven.line._receiver._scanner.encode = defect
    else:
        driven.line._write = defect
    now = driven.loop.time()
    EveryDevice(driven.driver).submit(driven.client.ask("06 00 01 00 05", unit=0, now=now), now)
    assert driven.client.answers == [None]
    assert isinstance(driven.events[0], PartFailed)
    driven.driver.close()


@pytest.mark.interpreted
async def test_a_request_that_cannot_even_be_started_is_answered() -> None:
    driven = Driven()
    await asyncio.sleep(0.1)
    driven.device.answer_time = Unanswerable()  # type: ignore[assignment]
    driven.ask()
    assert driven.client.answers == ["83 0B"]
    assert driven.port.closed
    driven.driver.close()


async def test_the_port_that_a_defect_has_closed_may_come_back() -> None:
    driven = Driven()
    await asyncio.sleep(0.1)
    driven.line._write = defect
    driven.ask()
    driven.driver.port_down(PortError("closed"))
    driven.driver.port_up(driven.port)
    await asyncio.sleep(1.0)
    driven.ask()
    driven.driver.received(bytes.fromhex(RESPONSE_FRAME))
    assert driven.client.answers == ["83 0B", RESPONSE]
    driven.driver.close()


async def test_a_connection_that_may_hold_back_a_request_is_closed_and_the_next_one_goes_on() -> None:
    driven = Driven()
    driven.port.has_arrived = lambda: True
    driven.driver.port_up(driven.port)
    driven.ask()
    await asyncio.sleep(0.8)
    assert driven.port.closed
    opened: list[bool] = []
    assert driven.driver.port_ended(lambda: opened.append(True), at_once=False)
    assert opened == [True]
    assert driven.driver.errors is None
    assert [event.line for event in driven.events if isinstance(event, ConnectionRenewed)] == ["hall-a"]
    assert not any(isinstance(event, PartFailed) for event in driven.events)
    driven.driver.received(b"\x55")
    port = FakePort()
    driven.driver.port_up(port)
    driven.ask()
    await asyncio.sleep(0.1)
    assert port.written == [READ_FRAME]
    driven.driver.close()


async def test_when_it_is_closed_it_sends_nothing_more() -> None:
    driven = Driven()
    driven.ask()
    driven.driver.close()
    await asyncio.sleep(1.0)
    assert driven.port.written == []


class Leave:
    """The Permission of a line that others ask on too: what it says each time, and how many others it heard."""

    def __init__(self, *says: bool) -> None:
        self.says = [*says]
        self.heard = 0

    def may_send(self) -> bool:
        return self.says.pop(0)

    def silence(self) -> float:
        return 3.0

    def heard_other(self) -> None:
        self.heard += 1


def shared(leave: Leave) -> Driven:
    driven = Driven()
    driven.driver = LineDriver(driven.line, driven.loop, driven.events.append, driven.rates.append, leave)
    driven.device = Device(Bench().device().settings, driven.driver)
    driven.driver.port_up(driven.port)
    return driven


async def test_on_a_shared_line_it_is_silent_at_first_and_looks_twice_before_each_write():
    driven = shared(leave := Leave(True, True))
    driven.loop.call_later(2.0, driven.ask)
    await asyncio.sleep(2.9)
    assert driven.port.written == []
    await asyncio.sleep(0.2)
    assert driven.port.written == [READ_FRAME]
    assert leave.says == []


async def test_without_leave_nothing_is_written_and_the_client_is_told_so():
    driven = shared(Leave(False))
    await asyncio.sleep(3.1)
    driven.ask()
    assert driven.client.answers == ["83 0A"]
    assert (driven.port.written, driven.port.closed) == ([], False)


async def test_when_the_leave_ends_between_both_looks_nothing_is_written_and_the_port_is_closed():
    driven = shared(Leave(True, False))
    await asyncio.sleep(3.1)
    driven.ask()
    assert (driven.port.written, driven.port.closed) == ([], True)
    driven.driver.port_down(PortError("closed"))
    assert driven.client.answers == ["83 0B"]


async def test_the_request_of_somebody_else_is_told():
    driven = shared(leave := Leave())
    driven.driver.received(bytes.fromhex("09 03 00 01 00 01 D4 82"))
    await asyncio.sleep(0.1)
    assert leave.heard == 1


@pytest.mark.interpreted
@pytest.mark.parametrize("where", ["before", "after"])
async def test_a_request_that_meets_a_defect_before_it_waits_gets_its_one_answer(where: str) -> None:
    driven = Driven()
    await asyncio.sleep(0.1)
    put = driven.line._scheduler.put

    def broken(transaction: Transaction, now: float) -> None:
        if where == "after":
            put(transaction, now)
        raise ZeroDivisionError

    driven.line._scheduler.put = broken  # type: ignore[method-assign, assignment]
    driven.ask()
    assert driven.client.answers == ["83 0A"]
    assert isinstance(driven.events[0], PartFailed)
    assert driven.port.closed
    driven.driver.close()


async def test_a_request_that_comes_first_behind_the_one_on_the_line_expires_in_time() -> None:
    """What comes behind others sets no timer: theirs are earlier."""
    driven = Driven(replace(SETTINGS, max_wait=0.1))
    await asyncio.sleep(1.0)
    driven.ask()
    driven.ask("03 00 20 00 01")
    await asyncio.sleep(0.05)
    driven.ask("03 00 30 00 01")
    await asyncio.sleep(0.06)
    assert driven.client.answers == ["83 06"]
    await asyncio.sleep(0.05)
    assert driven.client.answers == ["83 06", "83 06"]
    driven.driver.close()


async def test_who_waits_beside_a_repeat_does_not_wait_longer_than_others() -> None:
    driven = Driven(replace(SETTINGS, retries=1, max_wait=2.0, rest=0.0))

    def ask(unit: int, timeout: float) -> Asker:
        client, known = Asker(f"client of {unit}"), driven.device.settings
        settings = replace(
            known,
            name=f"unit-{unit}",
            unit=unit,
            known_as=unit,
            answer_time=replace(known.answer_time, timeout=timeout),
        )
        now = driven.loop.time()
        Device(settings, driven.driver).submit(client.ask(READ, unit=unit, now=now), now)
        return client

    ask(1, timeout=3.0)
    await asyncio.sleep(3.1)  # it is silent, and its repeat waits
    ask(2, timeout=6.0)
    await asyncio.sleep(2.5)  # that is on the line
    third = ask(3, timeout=0.2)
    await asyncio.sleep(2.1)
    assert third.answers == ["83 06"]
