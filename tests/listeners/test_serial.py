"""A server line on the clock and a port: it wakes by itself, and a defect in it stays in it."""

import asyncio
from collections.abc import Callable
from typing import cast

import pytest

from gateway.errors import PortError
from gateway.events import AnswerWithheld, Event, PartFailed
from gateway.listeners.serial import SerialListener
from gateway.listeners.sessions.server_line import LOOK_STEP, UNNOTICED, ServerSettings
from gateway.modbus import ascii as ascii_framing
from gateway.modbus.rtu import encode
from gateway.request import Request, Target
from gateway.timing.characters import LineTiming
from kit.server_bench import ASCII, RTU
from kit.virtual_time import VirtualTimeLoop

READ = encode(41, bytes.fromhex("03 0000 0002"))
RESPONSE = bytes.fromhex("03 04 45 9C 3D 51")
#: A request of an unknown function: a silence ends it.
UNKNOWN = encode(41, bytes.fromhex("41 01 02"))
#: Long enough for what is due already, in seconds.
AT_ONCE = 1e-6


class FakePort:
    latency = 0.005
    is_virtual = True
    has_arrived = None

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self.unread = b""
        self.received: Callable[[bytes], None]
        self.closed = False

    def read_now(self) -> None:
        data, self.unread = self.unread, b""
        if data:
            self.received(data)

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def close(self) -> None:
        self.closed = True


class Driven(Target):
    """A listener with an open port; `requests` are those that its client has sent.

    They are answered with `at_once`, if that is set.
    """

    def __init__(self, timing: LineTiming = RTU, **settings: object) -> None:
        self.events: list[Event] = []
        self.requests: list[Request] = []
        self.at_once: bytes | None = None
        settings = ServerSettings("panel", timing, frozenset({41}), **settings)
        self.listener = SerialListener(settings, self, asyncio.get_running_loop(), self.events.append)
        self.port = FakePort()
        self.port.received = self.listener.received
        self.listener.port_up(self.port)

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)
        if self.at_once is not None:
            request.respond(self.at_once)


async def test_a_damaged_request_is_none() -> None:
    driven = Driven()
    driven.listener.received(READ, damaged=True)
    assert driven.requests == []


async def test_it_waits_for_the_silence_and_answers() -> None:
    driven = Driven()
    driven.listener.received(READ)
    assert driven.listener.is_busy
    driven.requests[0].respond(RESPONSE)
    assert driven.port.written == []
    await asyncio.sleep(0.1)
    assert driven.port.written == [encode(41, RESPONSE)]
    assert not driven.listener.is_busy
    driven.listener.close()


async def test_an_answer_that_comes_later_goes_out_in_the_next_turn_of_the_loop() -> None:
    """Not in `respond`: nothing that has arrived is read in there, and no other request is handed on."""
    driven = Driven()
    driven.listener.received(READ)
    await asyncio.sleep(0.1)
    driven.requests[0].respond(RESPONSE)
    assert driven.port.written == []
    await asyncio.sleep(AT_ONCE)
    assert driven.port.written == [encode(41, RESPONSE)]
    driven.listener.close()


async def test_an_answer_is_dropped_when_the_next_request_stands_unread() -> None:
    driven = Driven()
    driven.listener.received(READ)
    await asyncio.sleep(0.1)
    driven.port.unread = encode(41, bytes.fromhex("03 0063 0001"))
    driven.requests[0].respond(RESPONSE)
    await asyncio.sleep(0.1)
    assert driven.port.written == []
    driven.requests[1].respond(bytes.fromhex("03 02 0007"))
    await asyncio.sleep(AT_ONCE)
    assert driven.port.written == [encode(41, bytes.fromhex("03 02 0007"))]
    driven.listener.close()


async def test_an_answer_that_waits_for_the_silence_is_dropped_when_the_next_request_stands_unread() -> None:
    driven = Driven()
    driven.listener.received(READ)
    driven.requests[0].respond(RESPONSE)
    driven.port.unread = encode(41, bytes.fromhex("03 0063 0001"))
    await asyncio.sleep(0.1)
    assert driven.port.written == []
    assert len(driven.requests) == 2
    driven.listener.close()


@pytest.mark.parametrize(("timing", "encoded"), [(RTU, encode), (ASCII, ascii_framing.encode)], ids=["rtu", "ascii"])
async def test_one_that_needs_no_silence_is_not_sent_before_all_that_has_arrived_is_read(
    timing: LineTiming, encoded: Callable[[int, bytes], bytes]
) -> None:
    """What is read at once comes in pieces, if it contains damaged characters, or is much."""
    driven = Driven(timing, gap=0.0)
    driven.at_once = RESPONSE
    driven.port.unread = encoded(41, bytes.fromhex("03 0063 0001"))
    driven.listener.received(encoded(41, bytes.fromhex("03 0000 0002")))
    driven.at_once = bytes.fromhex("03 02 0007")
    await asyncio.sleep(0.1)
    assert driven.port.written == [encoded(41, bytes.fromhex("03 02 0007"))]
    driven.listener.close()


async def test_after_the_order_to_finish_it_takes_no_requests() -> None:
    driven = Driven()
    driven.listener.finish()
    driven.listener.received(READ)
    assert driven.requests == []
    driven.listener.close()


async def test_a_lost_port_leaves_nobody_to_answer() -> None:
    driven = Driven()
    driven.listener.received(READ)
    driven.listener.port_down(PortError("pulled"))
    driven.requests[0].respond(RESPONSE)
    await asyncio.sleep(0.1)
    assert driven.port.written == []
    driven.listener.close()


async def test_a_defect_ends_at_the_error_boundary_and_the_port_is_reopened() -> None:
    driven = Driven()
    driven.listener.received(READ)

    def defect(*_: object) -> None:
        raise ZeroDivisionError

    driven.listener.session._write = defect
    driven.requests[0].respond(RESPONSE)
    await asyncio.sleep(0.1)
    assert driven.port.closed
    (told,) = driven.events
    assert isinstance(told, PartFailed)
    assert (told.part, "ZeroDivisionError" in told.traceback) == ("line panel", True)
    assert not driven.listener.is_busy
    driven.listener.port_down(PortError("closed"))
    driven.listener.port_up(driven.port)
    driven.listener.received(READ)
    driven.requests[1].respond(RESPONSE)
    await asyncio.sleep(0.1)
    assert driven.port.written == [encode(41, RESPONSE)]
    driven.listener.close()


async def test_a_second_defect_while_the_first_is_dealt_with_ends_at_the_error_boundary_too(monkeypatch) -> None:
    def defect(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("gateway.listeners.sessions.server_line.SerialSession.port_down", defect)
    monkeypatch.setattr("gateway.listeners.sessions.server_line.SerialSession.received", defect)
    driven = Driven()
    driven.listener.received(READ)
    assert [type(event) for event in driven.events] == [PartFailed, PartFailed]
    assert driven.port.closed
    driven.listener.close()


# --- when the gateway stood still ---


def wake_by_port(driven: Driven, data: bytes) -> None:
    """The loop finds first that the port has bytes."""
    driven.listener.received(data)


def wake_by_clock(driven: Driven, data: bytes) -> None:
    """The loop finds first that it is late."""
    driven.port.unread = data


WAKES = pytest.mark.parametrize("wake", [wake_by_port, wake_by_clock])


def stand_still(seconds: float) -> None:
    cast("VirtualTimeLoop", asyncio.get_running_loop()).stand_still(seconds)


@WAKES
async def test_a_request_that_was_read_too_late_is_neither_handed_on_nor_answered(wake: Callable[..., None]) -> None:
    """Its client has given it up, and would take the response for that to its next request. Nor is a write done."""
    driven = Driven()
    driven.at_once = RESPONSE
    await asyncio.sleep(10.0)
    stand_still(1.2)
    wake(driven, READ)
    await asyncio.sleep(0.5)
    assert (driven.requests, driven.port.written) == ([], [])
    (told,) = driven.events
    assert isinstance(told, AnswerWithheld)
    assert told.elapsed_ms >= 1000.0
    driven.listener.received(READ)
    await asyncio.sleep(0.1)
    assert driven.port.written == [encode(41, RESPONSE)]
    driven.listener.close()


@WAKES
@pytest.mark.parametrize("answered_after", [0.34, 0.41])
async def test_answer_within_counts_from_when_a_request_may_have_arrived(
    wake: Callable[..., None], answered_after: float
) -> None:
    driven = Driven()
    await asyncio.sleep(10.0)
    stand_still(0.6)
    wake(driven, READ)
    await asyncio.sleep(answered_after)
    assert driven.listener.is_busy is (answered_after < 0.4)
    driven.requests[0].respond(RESPONSE)
    await asyncio.sleep(AT_ONCE)
    assert len(driven.port.written) == (answered_after < 0.4)
    driven.listener.close()


async def test_a_stand_still_before_the_silence_that_ends_a_request_counts_too() -> None:
    driven = Driven()
    driven.at_once = RESPONSE
    driven.listener.received(UNKNOWN)
    stand_still(1.2)
    await asyncio.sleep(0.5)
    assert (driven.requests, driven.port.written) == ([], [])
    driven.listener.close()


@WAKES
async def test_one_that_is_a_little_longer_than_nobody_notices_counts(wake: Callable[..., None]) -> None:
    driven = Driven()
    await asyncio.sleep(10.0)
    stand_still(UNNOTICED + 0.01)
    wake(driven, READ)
    await asyncio.sleep(0.95)
    assert not driven.listener.is_busy
    driven.listener.close()


async def test_the_port_is_looked_at_while_a_request_is_in_progress_too() -> None:
    """Else the next request would count as one that was read late."""
    driven = Driven()
    driven.listener.received(READ)
    await asyncio.sleep(0.6)
    driven.listener.received(READ)
    await asyncio.sleep(0.98)
    driven.requests[1].respond(RESPONSE)
    await asyncio.sleep(AT_ONCE)
    assert driven.port.written == [encode(41, RESPONSE)]
    driven.listener.close()


@WAKES
async def test_a_pause_that_no_client_notices_is_no_stand_still(wake: Callable[..., None]) -> None:
    driven = Driven()
    await asyncio.sleep(10.0)
    stand_still(UNNOTICED - LOOK_STEP)
    wake(driven, READ)
    await asyncio.sleep(0.98)
    driven.requests[0].respond(RESPONSE)
    await asyncio.sleep(AT_ONCE)
    assert driven.port.written == [encode(41, RESPONSE)]
    driven.listener.close()


async def test_a_port_that_was_away_is_no_stand_still() -> None:
    driven = Driven()
    driven.at_once = RESPONSE
    driven.listener.port_down(PortError("pulled"))
    await asyncio.sleep(10.0)
    driven.listener.port_up(driven.port)
    driven.listener.received(READ)
    await asyncio.sleep(0.1)
    assert driven.port.written == [encode(41, RESPONSE)]
    driven.listener.close()
