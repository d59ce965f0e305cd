"""Function 08/04 makes a unit listen only, so nobody answers it: each kind of client may go on at once."""

import asyncio

from gateway.events import RequestTimeout, WriteAudit
from gateway.listeners.sessions.peer import Path, Peer
from gateway.modbus import mbap, rtu
from gateway.request import Caller
from kit.conversation import Conversation, Stage
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.over_tcp import OverTcpClient

CONFIG = """
[[listen]]
bind      = "tcp://127.0.0.1:5020"
in_flight = 1

[[listen]]
bind      = "rtu+tcp://127.0.0.1:5021"
in_flight = 1

[[line]]
name    = "hall-a"
port    = "/dev/hall"
baud    = 9600
devices = [{ unit = "1-2" }]

[[line]]
name   = "plc"
port   = "/dev/plc"
baud   = 9600
role   = "server"
serves = [1, 2]
"""
LISTEN_ONLY = "08 00 04 00 00"
READ = "03 00 00 00 01"
SEVEN = "03 02 00 07"


def furnish(bench: GatewayBench) -> None:
    """Unit 1 listens only, unit 2 answers."""
    device = SimulatedDevice(2)
    device.holding[0] = 7
    bench.attach("hall", SimulatedLine("rtu", device))


def failures(bench: GatewayBench) -> list[RequestTimeout]:
    return [event for event in bench.events if isinstance(event, RequestTimeout)]


async def test_a_client_of_modbus_tcp_has_its_place_back_and_nothing_has_failed() -> None:
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        client = bench.client()
        for _ in range(5):
            client.ask(1, LISTEN_ONLY)
        assert await client.asks(2, READ) == SEVEN
        assert client.responses.empty()
        assert failures(bench) == []
        assert [event.result for event in bench.events if isinstance(event, WriteAudit)] == ["ok"] * 5
        counts = bench.gateway.lines[0].devices[1].counts[8]
        assert (counts.ok, counts.sent, counts.timeout, counts.late_responses) == (5, 5, 0, 0)


async def test_a_client_of_rtu_over_tcp() -> None:
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        client = OverTcpClient(bench.gateway.listeners[1])
        assert await client.asks(LISTEN_ONLY, time_out=0.2) == b""
        assert client.session.is_idle
        assert await client.asks(READ, time_out=0.2, unit=2) == rtu.encode(2, bytes.fromhex(SEVEN))


async def test_a_client_of_modbus_udp() -> None:
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        sent: list[bytes] = []
        listener, path = bench.gateway.listeners[0], Path(lambda: None, sent.append)
        caller = Caller("127.0.0.1:1", "127.0.0.1", "127.0.0.1")
        peer = Peer(caller, router=listener.router, settings=listener.settings, path=path)
        for number, (unit, pdu) in enumerate([(1, LISTEN_ONLY), (2, READ)]):
            peer.received(mbap.TcpFrame(number, unit, bytes.fromhex(pdu)), asyncio.get_running_loop().time())
            await asyncio.sleep(0.2)
            assert peer.is_idle
        assert sent == [mbap.encode(1, 2, bytes.fromhex(SEVEN))]


async def test_a_client_on_a_server_line() -> None:
    steps = ("plc << 01 08 00 04 00 00 A1 CA", "hall >> 01 08 00 04 00 00 A1 CA", "wait 2 s", "plc silent")
    async with gateway_bench(CONFIG) as bench:
        await Stage(bench).play(Conversation("", steps))
        session = bench.gateway.servers[0].driver.session
        assert (session.is_idle, session.counts.silent, session.counts.too_late) == (True, 1, 0)
        assert failures(bench) == []
