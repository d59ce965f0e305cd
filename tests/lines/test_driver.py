"""A line on the clock and a port: it wakes by itself, and a defect in it stays in it."""

import asyncio

from gateway.errors import PortError
from gateway.events import Event, PartFailed
from gateway.lines.device import Device
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from kit.asker import Asker
from kit.line_bench import READ, READ_FRAME, RESPONSE, RESPONSE_FRAME, SETTINGS, Bench


class FakePort:
    latency = 0.005

    def __init__(self) -> None:
        self.written: list[str] = []
        self.closed = False

    def write(self, data: bytes) -> None:
        self.written.append(data.hex(" ").upper())

    def change_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        self.closed = True


class Driven:
    """A driver with an open port and one device."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.events: list[Event] = []
        self.line = Line(SETTINGS, self.events.append)
        self.rates: list[int] = []
        self.driver = LineDriver(self.line, self.loop, self.events.append, self.rates.append)
        self.port = FakePort()
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


async def test_a_defect_ends_at_the_border_requests_fail_and_the_port_is_reopened() -> None:
    driven = Driven()
    driven.ask()
    await asyncio.sleep(0.01)

    def defect(data: bytes, now: float) -> None:
        raise ZeroDivisionError

    driven.line.received = defect  # type: ignore[method-assign]
    driven.driver.received(b"\x01")
    assert driven.client.answers == ["83 0B"]
    assert driven.port.closed
    assert isinstance(driven.events[0], PartFailed)
    assert "ZeroDivisionError" in driven.events[0].traceback
    driven.driver.close()
