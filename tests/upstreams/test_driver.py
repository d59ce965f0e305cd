"""An upstream on the clock and a connection: it wakes by itself, hangs up when it must, and keeps its defects."""

import asyncio
from types import SimpleNamespace

import pytest

from gateway.devices.device import Device
from gateway.errors import PortError
from gateway.events import Event, PartFailed, UpstreamClosed
from gateway.modbus.mbap import encode
from gateway.upstreams import upstream as upstream_module
from gateway.upstreams.driver import TcpDriver
from gateway.upstreams.settings import UpstreamSettings
from gateway.upstreams.upstream import Upstream
from kit.asker import Asker
from kit.upstream_bench import READ, RESPONSE, UpstreamBench


class FakePort:
    latency = 0.0
    is_virtual = True
    has_arrived = None

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self.closed = False

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def read_now(self) -> None:
        pass

    def change_baud(self, baud: int) -> None:
        pass

    def close(self) -> None:
        self.closed = True


class Driven:
    """A driver with a connection and one unit."""

    def __init__(self, settings: UpstreamSettings | None = None) -> None:
        self.loop = asyncio.get_running_loop()
        self.events: list[Event] = []
        self.upstream = Upstream(settings or UpstreamSettings("plant-1"), self.events.append)
        self.driver = TcpDriver(self.upstream, self.loop, self.events.append)
        self.port = FakePort()
        self.driver.port_up(self.port)
        self.client = Asker()
        self.device = Device(UpstreamBench(timeout=0.5).device(37).settings, self.driver)

    def ask(self, pdu: str = READ, client: Asker | None = None) -> None:
        now = self.loop.time()
        self.device.submit((client or self.client).ask(pdu, now=now), now)


@pytest.fixture
async def driven():
    driven = Driven()
    yield driven
    driven.driver.close()


async def test_it_sends_and_takes_answers(driven: Driven) -> None:
    driven.ask()
    assert driven.port.written == [encode(1, 7, bytes.fromhex(READ))]
    driven.driver.received(encode(1, 7, bytes.fromhex(RESPONSE)))
    assert driven.client.answers == [RESPONSE]


async def test_it_answers_0b_when_the_limit_has_passed(driven: Driven) -> None:
    driven.ask()
    await asyncio.sleep(0.499)
    assert driven.client.answers == []
    await asyncio.sleep(0.002)
    assert driven.client.answers == ["83 0B"]


async def test_a_lost_connection_fails_what_is_under_way(driven: Driven) -> None:
    driven.ask()
    driven.driver.port_down(PortError("gone"))
    driven.ask()
    assert driven.client.answers == ["83 0B", "83 0A"]


async def test_it_hangs_up_when_what_comes_is_no_modbus(driven: Driven) -> None:
    driven.ask()
    driven.driver.received(b"HTTP/1.1 400 Bad Request\r\n")
    assert driven.client.answers == ["83 0B"]
    assert driven.port.closed
    (told,) = driven.events
    assert isinstance(told, UpstreamClosed)
    assert told.reason == "what came is not Modbus TCP: a protocol identifier of 21584; that of Modbus is 0"


@pytest.mark.interpreted
async def test_it_hangs_up_when_too_many_answers_are_overdue(driven: Driven, monkeypatch) -> None:
    monkeypatch.setattr(upstream_module, "MAX_OUTSTANDING", 1)
    driven.ask()
    await asyncio.sleep(0.6)
    assert driven.port.closed
    assert isinstance(driven.events[-1], UpstreamClosed)
    driven.driver.port_down(PortError("closed"))
    driven.driver.port_up(FakePort())
    driven.ask()
    assert driven.client.answers == ["83 0B"]


def defect(*_: object) -> None:
    raise ZeroDivisionError


@pytest.mark.interpreted
@pytest.mark.parametrize("where", ["write", "cut", "answers"])
async def test_a_defect_ends_at_the_error_boundary_and_each_request_gets_one_answer(
    driven: Driven, where: str, monkeypatch
):
    clients = [Asker(f"10.0.0.{number}:1") for number in range(4)]
    for client in clients[:2]:
        driven.ask(client=client)
    if where == "write":
        driven.upstream._connection.send = defect
    elif where == "cut":
        driven.driver._framer = SimpleNamespace(cut=defect)
    else:
        monkeypatch.setattr("gateway.upstreams.in_flight.answers", defect)
    driven.ask(client=clients[2])
    driven.driver.received(encode(1, 7, bytes.fromhex(RESPONSE)))
    driven.ask(client=clients[3])
    assert [len(client.answers) for client in clients] == [1, 1, 1, 1]
    assert clients[3].answers == ["83 0A"]
    assert isinstance(driven.events[0], PartFailed)
    assert driven.events[0].part == "upstream plant-1"
    assert "ZeroDivisionError" in driven.events[0].traceback
    assert driven.port.closed


@pytest.mark.interpreted
async def test_a_second_defect_while_the_first_is_dealt_with_ends_at_the_error_boundary_too(monkeypatch):
    monkeypatch.setattr(Upstream, "port_down", defect)
    driven = Driven()
    driven.driver._framer = SimpleNamespace(cut=defect)
    driven.driver.received(b"?")
    assert [type(event) for event in driven.events] == [PartFailed, PartFailed]
    assert driven.port.closed
    driven.driver.close()


async def test_a_server_that_sends_before_it_is_asked_is_no_server_with_identifier_0() -> None:
    """A new connection for each such frame would be one connection after the other, without end."""
    driven = Driven(UpstreamSettings("plant-1", in_flight=1, transaction_id="zero"))
    unasked = encode(0, 7, bytes.fromhex(RESPONSE))
    driven.port.read_now = lambda: driven.driver.received(unasked)
    driven.driver.port_down(PortError("closed"))
    driven.driver.port_up(driven.port)
    driven.ask()
    assert driven.port.written == []
    assert driven.port.closed
    (told,) = driven.events
    assert told.reason == "the server sends before it is asked, and does not say which request it answers"
    assert not driven.upstream.is_closed
    driven.ask()
    assert driven.client.answers == ["83 0A", "83 0A"]
    driven.driver.close()


async def test_after_a_request_the_same_is_a_reason_for_a_new_connection() -> None:
    driven = Driven(UpstreamSettings("plant-1", in_flight=1, transaction_id="zero"))
    driven.ask()
    driven.driver.received(encode(0, 7, bytes.fromhex(RESPONSE)))
    driven.driver.received(encode(0, 7, bytes.fromhex(RESPONSE)))
    assert driven.port.closed
    assert driven.events == []
    assert driven.upstream.is_closed
    driven.driver.close()
