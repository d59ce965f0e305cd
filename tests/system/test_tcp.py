"""The real listener on real sockets, with a target in the test's hands: who is kept, who is closed, and why."""

import asyncio
import gc
import shlex
import socket
import struct
import subprocess
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager, closing, suppress
from ipaddress import ip_network
from pathlib import Path
from typing import Any, Self

import pytest

from gateway.errors import ListenError
from gateway.events import ClientClosed, ClientConnected, ClientRejected, Event, PartFailed
from gateway.listeners import sockets as sockets_module
from gateway.listeners import tcp as tcp_module
from gateway.listeners.admission import NOT_MEANT
from gateway.listeners.connection import TcpConnection
from gateway.listeners.sessions import arrivals
from gateway.listeners.sessions import session as session_module
from gateway.listeners.sessions.arrivals import TOGETHER
from gateway.listeners.settings import ListenSettings
from gateway.listeners.sockets import KEEPALIVE_IDLE, KERNEL_BUFFER, USER_TIMEOUT
from gateway.listeners.tcp import TcpListener
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.mbap import encode
from gateway.ports import network
from gateway.request import Caller, NamedTarget, Request
from gateway.routing.access import EVERYTHING, AccessRow
from gateway.routing.rights import Rights
from kit.free_port import free_port
from kit.ipv6 import needs_ipv6
from kit.process import COMMAND, PATIENCE
from kit.router import to_everywhere

#: Units of the scripted target.
PROMPT, PATIENT, DEFECTIVE = 1, 2, 3
READ = bytes.fromhex("03 0000 007D")
RESPONSE = bytes.fromhex("03 FA") + bytes(250)
#: The deadlines of these tests, in seconds: those of the gateway, made shorter.
SWEEP, CLOSING, SENDING, TAKING = 0.02, 0.2, 0.4, 0.4
#: How long nothing must happen for a test to believe that nothing will.
SILENCE = 0.15


@pytest.fixture(autouse=True)
def _in_a_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp_module, "SWEEP_STEP", SWEEP)
    monkeypatch.setattr(tcp_module, "CLOSING_DEADLINE", CLOSING)
    monkeypatch.setattr(session_module, "SENDING_DEADLINE", SENDING)
    monkeypatch.setattr(session_module, "TAKING_DEADLINE", TAKING)


class Plant(NamedTarget):
    """A target that answers PROMPT at once, keeps requests to PATIENT, and has a defect in DEFECTIVE."""

    def __init__(self) -> None:
        self.name = "plant"
        self.submitted = 0
        self.waiting: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.submitted += 1
        if request.unit == DEFECTIVE:
            raise RuntimeError("nobody foresaw this")
        if request.unit == PATIENT:
            self.waiting.append(request)
        else:
            request.respond(RESPONSE)

    def answer_all(self) -> None:
        for request in self.waiting:
            request.respond(RESPONSE)
        self.waiting.clear()


class Bench:
    """A listener that accepts, and what it tells."""

    def __init__(self, settings: ListenSettings) -> None:
        self.plant = Plant()
        self.events: list[Event] = []
        self.listener = TcpListener(settings, to_everywhere(self.plant), self.events.append)
        self.clients: list[Client] = []

    @property
    def port(self) -> int:
        return int(self.listener.address.rsplit(":", 1)[1])

    async def connect(self, host: str = "127.0.0.1", *, source: str = "", small_window: bool = False) -> "Client":
        """A client that is connected, if only for the system; from the address `source`."""
        client = await Client.connect(self.port, host, source=source, small_window=small_window)
        self.clients.append(client)
        return client

    async def client(self, *, small_window: bool = False) -> "Client":
        """A client that the listener has accepted or sent away."""
        known = len(self.told(ClientConnected)) + len(self.told(ClientRejected))
        client = await self.connect(small_window=small_window)
        await until(lambda: len(self.told(ClientConnected)) + len(self.told(ClientRejected)) > known)
        return client

    def told(self, kind: type[Event]) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]

    def reason(self, client: "Client", kind: type[Event] = ClientClosed) -> str:
        """Why `client` was closed; empty when it was not."""
        return next((event.reason for event in self.told(kind) if event.client == client.name), "")

    async def closes(self, client: "Client") -> str:
        """Wait until the connection has ended; why."""
        await until(lambda: self.reason(client))
        return self.reason(client)


class Client:
    """A Modbus TCP client that reads 125 registers at a time."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer
        host, port = writer.get_extra_info("sockname")[:2]
        self.name = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self._transaction = 0

    @classmethod
    async def connect(cls, port: int, host: str = "127.0.0.1", *, source: str = "", small_window: bool = False) -> Self:
        sock = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        if source:
            sock.bind((source, 0))
        if small_window:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sock.setblocking(False)
        try:
            await asyncio.get_running_loop().sock_connect(sock, (host, port))
        except OSError:
            sock.close()
            raise
        return cls(*await asyncio.open_connection(sock=sock, limit=1024 if small_window else 2**16))

    def ask(self, unit: int = PROMPT, count: int = 1) -> None:
        """Send `count` requests in one piece."""
        first, self._transaction = self._transaction + 1, self._transaction + count
        self.writer.write(b"".join(encode(each, unit, READ) for each in range(first, self._transaction + 1)))

    async def answer(self) -> int:
        """The transaction of the next response."""
        async with asyncio.timeout(PATIENCE):
            adu = await self.reader.readexactly(7 + len(RESPONSE))
        assert adu[7:] == RESPONSE
        return int.from_bytes(adu[:2])

    async def asks(self, unit: int = PROMPT) -> int:
        self.ask(unit)
        return await self.answer()

    async def is_closed(self) -> bool:
        """Whether the gateway closes the connection, soon, without a word more."""
        try:
            async with asyncio.timeout(PATIENCE):
                return await self.reader.read(1) == b""
        except ConnectionError:
            return True

    async def is_open(self) -> bool:
        return await self.asks() == self._transaction

    def reset(self) -> None:
        """End with a reset."""
        sock = self.writer.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.writer.transport.abort()


@asynccontextmanager
async def listening(
    clients: int = 32, idle: float = 0, host: str = "127.0.0.1", **settings: Any
) -> AsyncIterator[Bench]:
    bench = Bench(ListenSettings("scada", host, free_port(), clients=clients, idle=idle, **settings))
    await bench.listener.find()
    bench.listener.bind()
    bench.listener.listen()
    bench.listener.start()
    try:
        yield bench
    finally:
        bench.listener.close()
        for client in bench.clients:
            client.writer.transport.abort()
        await until(lambda: not bench.listener.has_clients)


async def until(condition: Callable[[], object]) -> None:
    """Wait for something that should come."""
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - plain calls set no event
            await asyncio.sleep(0.002)


async def block(client: Client, bench: Bench) -> None:
    """Let `client` ask for more than it takes, until the gateway keeps its responses."""
    client.ask(count=2000)
    connection = next(each for each in bench.listener.connections if each.caller.client == client.name)
    await until(lambda: connection.session._back_pressure.blocked_at is not None)


# --- room ---


async def test_when_full_the_client_that_has_been_idle_longest_makes_room() -> None:
    async with listening(clients=2) as bench:
        first, second = await bench.client(), await bench.client()
        await second.asks()
        await first.asks()
        third = await bench.client()
        assert await second.is_closed()
        assert await bench.closes(second) == "made room for another client"
        assert bench.reason(second, ClientRejected) == "made room for another client"
        assert (bench.listener.counts.accepted, bench.listener.counts.rejected) == (3, 1)
        assert await first.is_open()
        assert await third.is_open()


async def test_a_client_with_a_request_under_way_never_makes_room() -> None:
    async with listening(clients=2) as bench:
        busy = await bench.client()
        busy.ask(PATIENT)
        await until(lambda: bench.plant.waiting)
        idle = await bench.client()
        await bench.client()
        assert await idle.is_closed()
        bench.plant.answer_all()
        assert await busy.answer() == 1


async def test_when_all_are_busy_the_new_client_is_sent_away() -> None:
    async with listening(clients=2) as bench:
        busy = [await bench.client(), await bench.client()]
        for client in busy:
            client.ask(PATIENT)
        await until(lambda: len(bench.plant.waiting) == 2)
        refused = await bench.client()
        assert await refused.is_closed()
        reason = "too many clients, and all of them have requests in progress"
        assert bench.reason(refused, ClientRejected) == reason
        bench.plant.answer_all()
        assert [await client.answer() for client in busy] == [1, 1]


async def test_there_are_never_more_clients_than_allowed_though_some_read_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is being closed counts no more, so it makes room once only; and it is gone after a moment."""
    monkeypatch.setattr(session_module, "TAKING_DEADLINE", PATIENCE)
    async with listening(clients=2) as bench:
        for _ in range(6):
            await block(await bench.client(small_window=True), bench)
            assert len(bench.listener.connections) <= 2
        last = await bench.client()
        assert await last.is_open()
        assert len(bench.listener.connections) == 2
        await until(lambda: not bench.listener._closing)
        assert len(bench.told(ClientConnected)) - len(bench.told(ClientClosed)) == 2


async def test_a_hundred_clients_in_a_row_find_room() -> None:
    async with listening(clients=4) as bench:
        clients = [await bench.connect() for _ in range(100)]
        await until(lambda: len(bench.told(ClientConnected)) == 100)
        await until(lambda: len(bench.told(ClientClosed)) == 96)
        assert [await client.is_open() for client in clients[96:]] == [True] * 4


async def test_an_address_that_has_many_connections_drives_out_none_of_another() -> None:
    """C03, in small."""
    async with listening(clients=4) as bench:
        first = await bench.client()
        flood = [await bench.connect(source="127.0.0.2") for _ in range(20)]
        await until(lambda: len(bench.told(ClientClosed)) == 17)
        assert await first.is_open()
        assert [await client.is_open() for client in flood[17:]] == [True] * 3


async def test_a_crowd_of_addresses_never_closes_a_client_that_asks_as_usual() -> None:
    """Promise P18: the crowd is half as large again as the room, and asks without a pause; see also test_room."""
    async with listening(clients=20) as bench:
        client = await bench.client()
        for _ in range(3):
            await client.asks()
            await asyncio.sleep(0.5)
        over = asyncio.Event()
        crowd = asyncio.gather(*(come_and_go(bench, f"127.0.1.{number}", over) for number in range(1, 31)))
        for _ in range(6):
            assert await client.is_open()
            await asyncio.sleep(0.5)
        await until(lambda: len(bench.told(ClientRejected)) > 30)
        assert await client.is_open()
        assert not bench.reason(client)
        over.set()
        await crowd


async def come_and_go(bench: Bench, source: str, over: asyncio.Event) -> None:
    """Connect, ask as long as there are answers, and connect again, until it is `over`."""
    while not over.is_set():
        with suppress(OSError, EOFError):
            client = await Client.connect(bench.port, source=source)
            with closing(client.writer):
                while not over.is_set():
                    await client.asks()
                    await asyncio.sleep(0.01)
        await asyncio.sleep(0.01)


async def test_unknown_clients_leave_the_reserve_to_those_whom_rows_name() -> None:
    async with listening(clients=4, reserve=2) as bench:
        named = AccessRow(EVERYTHING, networks=(ip_network("127.0.0.9"),))
        bench.listener.router.rights = Rights((named, AccessRow(EVERYTHING)), bench.listener.router.entry)
        other_clients = [await bench.connect(source=f"127.0.0.{number}") for number in range(20, 24)]
        assert await other_clients[0].is_closed()
        assert await other_clients[1].is_closed()
        friends = [await bench.connect(source="127.0.0.9") for _ in range(2)]
        assert [await client.is_open() for client in (*other_clients[2:], *friends)] == [True] * 4


# --- who says nothing, who says half, who does not listen ---


async def test_an_idle_client_is_closed_and_a_busy_one_is_left_alone() -> None:
    async with listening(idle=3.0) as bench:
        busy, idle = await bench.client(), await bench.client()
        busy.ask(PATIENT)
        assert await idle.is_closed()
        assert await bench.closes(idle) == "idle"
        assert not bench.told(ClientRejected)
        await asyncio.sleep(0.3)  # the busy one has been quiet for longer than that
        bench.plant.answer_all()
        assert await busy.answer() == 1


async def test_without_an_idle_time_nobody_is_idle() -> None:
    async with listening(idle=0) as bench:
        client = await bench.client()
        await asyncio.sleep(3 * SILENCE)
        assert await client.is_open()


@pytest.mark.interpreted
@pytest.mark.parametrize("drip", [b"", bytes(1000)], ids=["slowloris (C01)", "slow drip (C02)"])
async def test_a_client_that_sends_half_a_request_is_closed(drip: bytes) -> None:
    async with listening(clients=200) as bench:
        healthy = await bench.client()
        half = [await bench.connect() for _ in range(100)]
        for client in half:
            client.writer.write(bytes.fromhex("0001 0000 00FE"))
        drops = iter(drip)
        for byte in drops:
            if len(bench.told(ClientClosed)) == len(half):
                break
            for client in half:
                client.writer.write(bytes((byte,)))
            await asyncio.sleep(SWEEP)
        assert len(bytes(drops)) >= len(drip) / 2, "as long as something comes it waits"
        assert all([await client.is_closed() for client in half])
        assert bench.reason(half[0], ClientRejected) == f"sent no whole request within {SENDING:g} s"
        assert await healthy.is_open()


async def test_a_slow_reader_is_read_no_more_and_gets_everything_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "TAKING_DEADLINE", PATIENCE)
    async with listening() as bench:
        slow = await bench.client(small_window=True)
        await block(slow, bench)
        submitted = bench.plant.submitted
        await asyncio.sleep(SILENCE)
        assert bench.plant.submitted == submitted < 1500
        assert [await slow.answer() for _ in range(2000)] == list(range(1, 2001))


@pytest.mark.interpreted
async def test_a_client_that_reads_nothing_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """C08: others are served meanwhile, and the connection ends though its responses were never taken."""
    async with listening() as bench:
        deaf, healthy = await bench.client(small_window=True), await bench.client()
        await block(deaf, bench)
        assert await healthy.is_open()
        assert await bench.closes(deaf) == f"took no responses for {TAKING:g} s"
        assert bench.reason(deaf, ClientRejected) == bench.reason(deaf)
        assert await healthy.is_open()


async def test_a_half_closed_client_that_reads_slowly_gets_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "TAKING_DEADLINE", PATIENCE)
    monkeypatch.setattr(tcp_module, "CLOSING_DEADLINE", PATIENCE)
    async with listening() as bench:
        slow = await bench.client(small_window=True)
        slow.ask(count=400)
        slow.writer.write_eof()
        await asyncio.sleep(SILENCE)
        assert [await slow.answer() for _ in range(400)] == list(range(1, 401))
        assert await slow.is_closed()


# --- how clients leave ---


async def test_a_half_closed_client_is_answered_then_closed() -> None:
    """C07."""
    async with listening() as bench:
        client = await bench.client()
        client.ask(PATIENT)
        client.writer.write_eof()
        await until(lambda: bench.plant.waiting)
        await asyncio.sleep(SILENCE)
        assert not bench.reason(client)
        bench.plant.answer_all()
        assert await client.answer() == 1
        assert await client.is_closed()
        assert await bench.closes(client) == "the client closed it"


async def test_a_request_knows_what_counts_as_the_address_of_its_client() -> None:
    """As at the admission of clients: of IPv6, the network of one customer."""
    async with listening() as bench:
        bench.listener._share_keys.of = lambda host, now: f"the network of {host}"  # type: ignore[method-assign]
        client = await bench.client()
        client.ask(PATIENT)
        await until(lambda: bench.plant.waiting)
        assert bench.plant.waiting[0].caller == Caller(client.name, "127.0.0.1", "the network of 127.0.0.1")
        bench.plant.answer_all()


async def test_a_reset_marks_what_is_under_way_as_unwanted() -> None:
    async with listening() as bench:
        client = await bench.client()
        client.ask(PATIENT, count=3)
        await until(lambda: len(bench.plant.waiting) == 3)
        assert all(request.origin.wants(request) for request in bench.plant.waiting)
        client.reset()
        assert await bench.closes(client) == "lost: connection reset by peer"
        assert not any(request.origin.wants(request) for request in bench.plant.waiting)
        bench.plant.answer_all()


async def test_connections_reset_at_once_leave_nothing_behind(caplog: pytest.LogCaptureFixture) -> None:
    """C10, in small."""
    async with listening(clients=4) as bench:
        for _ in range(500):
            (await bench.connect()).reset()
        await until(lambda: not bench.listener.has_clients)
        assert await (await bench.client()).is_open()
        assert not bench.told(PartFailed)
    assert not caplog.records


@pytest.mark.parametrize("scheme", ["tcp", "rtu+tcp"])
@pytest.mark.parametrize("leaves", ["it goes", "it is reset", "it is closed"])
async def test_who_leaves_is_freed_without_the_collector_which_passes_over_those_that_were_there_at_a_reload(
    scheme: str, leaves: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "SENDING_DEADLINE", PATIENCE)

    def remains() -> list[TcpConnection]:
        found = (each for each in gc.get_objects() if isinstance(each, TcpConnection))
        return [each for each in found if each.caller.client == client.name]

    async with listening(scheme=scheme) as bench:
        gc.disable()
        try:
            client = await bench.client()

            def has_begun() -> bool:
                client.writer.write(b"\x00")  # again: behind a silence it is forgotten, before a busy machine looks
                return remains()[0].session.has_begun

            await until(has_begun)
            if leaves == "it goes":
                client.writer.close()
            elif leaves == "it is reset":
                client.reset()
            else:
                bench.listener.close()
            await bench.closes(client)
            await until(lambda: not remains())
        finally:
            gc.enable()


# --- bounds and error boundaries ---


async def test_beyond_in_flight_nothing_is_read_until_a_response_has_gone() -> None:
    async with listening(in_flight=4) as bench:
        client = await bench.client()
        client.ask(PATIENT, count=10)
        for waiting in (4, 4, 2):
            await until(lambda: bench.plant.waiting)
            await asyncio.sleep(SILENCE)
            assert len(bench.plant.waiting) == waiting
            bench.plant.answer_all()
        assert [await client.answer() for _ in range(10)] == list(range(1, 11))


async def test_a_thousand_requests_in_a_row_get_a_thousand_responses() -> None:
    async with listening() as bench:
        client = await bench.client()
        client.ask(count=1000)
        assert [await client.answer() for _ in range(1000)] == list(range(1, 1001))
        assert bench.plant.submitted == 1000


async def test_a_defect_ends_its_own_connection_only() -> None:
    async with listening() as bench:
        client, other = await bench.client(), await bench.client()
        client.ask(DEFECTIVE)
        assert await client.is_closed()
        assert await bench.closes(client) == "a defect in the gateway"
        [told] = bench.told(PartFailed)
        assert told.part == f"client {client.name}"
        assert "nobody foresaw this" in told.traceback
        assert await other.is_open()


JUNK = {
    "HTTP": b"GET / HTTP/1.1\r\nHost: plc\r\n\r\n",
    "TLS": bytes.fromhex("16 03 01 02 00 01 00 01 FC 03 03") + bytes(200),
    "TLS, short": bytes.fromhex("16 03 01 00 F4 01 00 00 F0 03 03") + bytes(200),
    "SSH": b"SSH-2.0-OpenSSH_9.2p1\r\n",
    "RTU": bytes.fromhex("01 03 00 00 00 01 84 0A"),
    "0xFF": b"\xff" * 300,
}


@pytest.mark.parametrize("junk", JUNK.values(), ids=JUNK)
async def test_what_is_no_modbus_is_closed_at_once(junk: bytes) -> None:
    async with listening() as bench:
        client, other = await bench.client(), await bench.client()
        client.writer.write(junk)
        assert await client.is_closed()
        assert "an MBAP length of" in await bench.closes(client)
        assert bench.reason(client, ClientRejected) == bench.reason(client)
        assert await other.is_open()
        assert not bench.told(PartFailed)


async def test_a_client_that_vanishes_is_noticed_and_responses_leave_at_once() -> None:
    async with listening() as bench:
        await bench.client()
        [connection] = bench.listener.connections
        sock = connection.stream._socket
        assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == KEEPALIVE_IDLE
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == USER_TIMEOUT
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1


async def test_the_system_keeps_little_for_a_connection() -> None:
    async with listening() as bench:
        await bench.client()
        [connection] = bench.listener.connections
        sock = connection.stream._socket
        for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            assert sock.getsockopt(socket.SOL_SOCKET, option) == 2 * KERNEL_BUFFER  # Linux counts its own share too


async def test_a_defect_in_welcoming_a_client_does_not_end_the_listener(monkeypatch: pytest.MonkeyPatch) -> None:
    async with listening() as bench:
        with monkeypatch.context() as defective:
            defective.setattr(bench.listener.connections, "make_room", None)
            assert await (await bench.connect()).is_closed()
        assert len(bench.told(PartFailed)) == 1
        assert await (await bench.client()).is_open()


# --- the end ---


async def test_a_listener_that_finishes_accepts_nobody_and_takes_no_more_requests() -> None:
    async with listening() as bench:
        port, idle, busy = bench.port, await bench.client(), await bench.client()
        busy.ask(PATIENT)
        await until(lambda: bench.plant.waiting)
        bench.listener.finish()
        assert await idle.is_closed()
        busy.ask(PROMPT)
        with pytest.raises(ConnectionRefusedError):
            await Client.connect(port)
        await asyncio.sleep(SILENCE)
        assert bench.plant.submitted == 1
        bench.plant.answer_all()
        assert await busy.answer() == 1
        assert await busy.is_closed()
        assert await bench.closes(idle) == await bench.closes(busy) == "the gateway is stopping"
        assert not bench.listener.has_clients


async def test_a_listener_that_closes_ends_all_connections() -> None:
    async with listening() as bench:
        client = await bench.client()
        client.ask(PATIENT)
        await until(lambda: bench.plant.waiting)
        bench.listener.close()
        assert await bench.closes(client) == "the gateway is stopping"
        assert not bench.plant.waiting[0].origin.wants(bench.plant.waiting[0])


# --- addresses ---


async def test_two_listeners_on_one_port_are_an_error_in_words() -> None:
    async with listening() as bench:
        second = TcpListener(ListenSettings("all", "0.0.0.0", bench.port), bench.listener.router, bench.events.append)
        await second.find()
        with pytest.raises(ListenError, match=r"cannot listen on tcp://0\.0\.0\.0:\d+: another \[\[listen\]\]"):
            second.bind()


async def test_a_port_that_is_taken_between_bind_and_start_is_an_error_in_words() -> None:
    port = free_port()
    first = TcpListener(ListenSettings("a", "127.0.0.1", port), to_everywhere(Plant()), print)
    await first.find()
    first.bind()
    settings = ListenSettings("b", "0.0.0.0", port, source="gateway.toml:7")
    second = TcpListener(settings, to_everywhere(Plant()), lambda event: None)
    await second.find()
    second.bind()
    with closing(first), closing(second):
        second.listen()
        second.start()
        with pytest.raises(ListenError, match=r"cannot listen on tcp://127\.0\.0\.1:\d+: another \[\[listen\]\]"):
            first.listen()


@pytest.mark.parametrize("host", ["a..b", "x" * 70])
async def test_what_is_no_host_name_is_an_error_in_words(host: str) -> None:
    listener = TcpListener(ListenSettings("a", host, 0, source="gateway.toml:7"), to_everywhere(Plant()), print)
    with pytest.raises(ListenError, match=r"gateway\.toml:7: cannot listen on tcp://.*: this is not a valid host name"):
        await listener.find()


def test_a_name_server_that_does_not_answer_holds_up_neither_the_start_nor_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    released = threading.Event()
    monkeypatch.setattr(sockets_module, "LOOKUP_DEADLINE", 0.1)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: released.wait(PATIENCE) and [])
    listener = TcpListener(ListenSettings("a", "plant.example", 0), to_everywhere(Plant()), print)
    begin = time.monotonic()
    with pytest.raises(ListenError, match=r"cannot listen on tcp://plant\.example:0: no name server answers"):
        asyncio.run(listener.find())
    assert time.monotonic() - begin < PATIENCE / 2
    network._under_way.clear()
    released.set()


@needs_ipv6
async def test_an_ipv6_listener_takes_ipv4_clients_who_look_like_such() -> None:
    """C15."""
    async with listening(host="::") as bench:
        assert bench.listener.address.startswith("tcp://[::]:")
        old = await bench.client()
        new = await bench.connect("::1")
        assert await old.is_open()
        assert await new.is_open()
        assert [event.client for event in bench.told(ClientConnected)] == [old.name, new.name]
        assert {each.caller.host for each in bench.listener.connections} == {"127.0.0.1", "::1"}


@needs_ipv6
@pytest.mark.parametrize("order", [("0.0.0.0", "::"), ("::", "0.0.0.0")])
async def test_an_ipv6_listener_leaves_ipv4_to_another_one_when_it_is_told_to(order: tuple[str, str]) -> None:
    port = free_port()
    events: dict[str, list[Event]] = {host: [] for host in order}
    listeners = [
        TcpListener(
            ListenSettings(host, host, port, ipv6_only=host == "::"), to_everywhere(Plant()), events[host].append
        )
        for host in order
    ]
    with ExitStack() as stack:
        for listener in listeners:
            stack.enter_context(closing(listener))
            await listener.find()
            listener.bind()
        for listener in listeners:
            listener.listen()
            listener.start()
        old, new = await Client.connect(port), await Client.connect(port, "::1")
        assert await old.is_open()
        assert await new.is_open()
        for host, client in (("0.0.0.0", old), ("::", new)):
            assert [event.client for event in events[host] if isinstance(event, ClientConnected)] == [client.name]
            client.writer.transport.abort()


# --- RTU and ASCII ---


@pytest.fixture(params=["rtu+tcp", "ascii+tcp"])
def scheme(request: pytest.FixtureRequest) -> str:
    return request.param


ENCODE = {"rtu+tcp": rtu.encode, "ascii+tcp": ascii_framing.encode}


async def hears(client: Client, *adus: bytes) -> bool:
    """Whether exactly these responses come."""
    async with asyncio.timeout(PATIENCE):
        expected = b"".join(adus)
        return await client.reader.readexactly(len(expected)) == expected


@pytest.fixture
def _never_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is sent together counts as that, however long a machine holds the test up; not in compiled modules."""
    monkeypatch.setattr(arrivals, "TOGETHER", PATIENCE)


@pytest.mark.interpreted
@pytest.mark.usefixtures("_never_late")
async def test_requests_in_pieces_and_in_one_piece_get_their_responses(
    scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrivals, "SILENCE", PATIENCE)
    monkeypatch.setattr(session_module, "SENDING_DEADLINE", PATIENCE)
    encode_as = ENCODE[scheme]
    async with listening(scheme=scheme) as bench:
        assert bench.listener.address.startswith(f"{scheme}://127.0.0.1:")
        client = await bench.client()
        for byte in encode_as(PROMPT, READ):
            client.writer.write(bytes((byte,)))
            await asyncio.sleep(0.002)
        assert await hears(client, encode_as(PROMPT, RESPONSE))
        client.writer.write(100 * encode_as(PROMPT, READ))
        assert await hears(client, 100 * encode_as(PROMPT, RESPONSE))


@pytest.mark.interpreted
@pytest.mark.usefixtures("_never_late")
async def test_requests_that_come_together_are_answered_one_after_the_other(scheme: str) -> None:
    encode_as = ENCODE[scheme]
    async with listening(scheme=scheme, in_flight=2) as bench:
        client = await bench.client()
        client.writer.write(10 * encode_as(PATIENT, READ))
        for _ in range(10):
            await until(lambda: bench.plant.waiting)
            await asyncio.sleep(0.02)
            assert len(bench.plant.waiting) == 1
            bench.plant.answer_all()
        assert await hears(client, 10 * encode_as(PATIENT, RESPONSE))
        assert bench.plant.submitted == 10


async def test_a_response_that_the_client_has_given_up_is_dropped(scheme: str) -> None:
    encode_as = ENCODE[scheme]
    async with listening(scheme=scheme) as bench:
        client = await bench.client()
        client.writer.write(encode_as(PATIENT, READ))
        await until(lambda: bench.plant.waiting)
        await asyncio.sleep(4 * TOGETHER)
        client.writer.write(encode_as(PROMPT, READ))
        assert await hears(client, encode_as(PROMPT, RESPONSE))
        assert not bench.plant.waiting[0].origin.wants(bench.plant.waiting[0])
        bench.plant.answer_all()
        client.writer.write(encode_as(PROMPT, READ))
        assert await hears(client, encode_as(PROMPT, RESPONSE))


async def test_after_half_a_frame_and_after_noise_the_next_request_is_answered(
    scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "SENDING_DEADLINE", PATIENCE)  # else a little longer than the silence here
    encode_as = ENCODE[scheme]
    async with listening(scheme=scheme) as bench:
        client = await bench.client()
        [connection] = bench.listener.connections
        for noise in (encode_as(PROMPT, READ)[:-3], b"\xff noise \x00", encode_as(PROMPT, READ)[:-4] + b"00\r\n"):
            client.writer.write(noise)
            await until(lambda: connection.session._arrivals.noise)  # the silence begins when it has been read
            await asyncio.sleep(1.5 * arrivals.SILENCE)
            client.writer.write(encode_as(PROMPT, READ))
            assert await hears(client, encode_as(PROMPT, RESPONSE))


async def test_silence_ends_a_request_of_unknown_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "SENDING_DEADLINE", PATIENCE)  # else a little longer than the silence
    async with listening(scheme="rtu+tcp") as bench:
        client = await bench.client()
        client.writer.write(rtu.encode(PROMPT, bytes.fromhex("41 01 02 03")))
        assert await hears(client, rtu.encode(PROMPT, RESPONSE))


async def test_what_is_neither_rtu_nor_ascii_is_closed(scheme: str) -> None:
    async with listening(scheme=scheme) as bench:
        client, other = await bench.client(), await bench.client()
        client.writer.write(100 * JUNK["HTTP"])
        assert await client.is_closed()
        assert (await bench.closes(client)).endswith("bytes without a request")
        other.writer.write(ENCODE[scheme](PROMPT, READ))
        assert await hears(other, ENCODE[scheme](PROMPT, RESPONSE))


@pytest.mark.interpreted
async def test_ascii_that_is_never_finished_is_closed() -> None:
    async with listening(scheme="ascii+tcp") as bench:
        client = await bench.client()
        client.writer.write(b":0103")
        assert await client.is_closed()
        assert await bench.closes(client) == f"sent no whole request within {SENDING:g} s"


@pytest.mark.interpreted
@pytest.mark.usefixtures("_never_late")
async def test_a_defect_ends_its_own_connection_only_whatever_it_speaks(scheme: str) -> None:
    """Also when the request had to wait, and the connection was woken for it."""
    encode_as = ENCODE[scheme]
    async with listening(scheme=scheme) as bench:
        client, other = await bench.client(), await bench.client()
        client.writer.write(encode_as(PATIENT, READ) + encode_as(DEFECTIVE, READ))
        await until(lambda: bench.plant.waiting)
        bench.plant.answer_all()
        assert await hears(client, encode_as(PATIENT, RESPONSE))
        assert await client.is_closed()
        assert await bench.closes(client) == "a defect in the gateway"
        other.writer.write(encode_as(PROMPT, READ))
        assert await hears(other, encode_as(PROMPT, RESPONSE))


async def test_idle_clients_and_those_beyond_the_bound_are_treated_as_for_modbus_tcp(scheme: str) -> None:
    async with listening(scheme=scheme, clients=1, idle=3.0) as bench:
        first = await bench.client()
        second = await bench.client()
        assert await first.is_closed()
        assert await bench.closes(first) == "made room for another client"
        assert await second.is_closed()
        assert await bench.closes(second) == "idle"


def test_a_socket_that_is_bound_already_is_used_and_one_that_nobody_names_is_told(tmp_path: Path) -> None:
    """As systemd does it: descriptors from 3 on."""
    with socket.socket() as door, socket.socket() as stray:
        for sock in (door, stray):
            sock.bind(("127.0.0.1", 0))
            sock.listen()
        address = "{}:{}".format(*door.getsockname())
        config = tmp_path / "gateway.toml"
        config.write_text(f'[[listen]]\nbind = "tcp://{address}"\n[[image]]\nunit = 1\nholding = 1\n')
        run = [*COMMAND, "run", "--control", str(tmp_path / "control.sock"), str(config)]
        with subprocess.Popen(
            _activated(run, door), pass_fds=[door.fileno()], stderr=subprocess.PIPE, text=True
        ) as one:
            with socket.create_connection(door.getsockname(), timeout=PATIENCE) as client:
                client.sendall(bytes.fromhex("0001 0000 0006 01 03 0000 0001"))
                assert client.recv(260) == bytes.fromhex("0001 0000 0005 01 03 02 0000")
            one.terminate()
            assert one.wait(PATIENCE) == 0
        both = subprocess.run(
            _activated(run, door, stray), pass_fds=[door.fileno(), stray.fileno()], capture_output=True, text=True,
            check=False, timeout=PATIENCE,
        )  # fmt: skip
        assert both.returncode == 1
        assert "systemd has opened tcp://{}:{}, which no [[listen]] names".format(*stray.getsockname()) in both.stderr


@needs_ipv6
@pytest.mark.parametrize(("bind", "served"), [("0.0.0.0", ("127.0.0.1", "127.0.0.2")), ("127.0.0.1", ("127.0.0.1",))])
def test_a_socket_that_takes_more_than_the_listener_serves_nobody_else(
    tmp_path: Path, bind: str, served: tuple[str, ...]
) -> None:
    with socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True) as door:
        port = door.getsockname()[1]
        config = tmp_path / "gateway.toml"
        config.write_text(f'[[listen]]\nbind = "tcp://{bind}:{port}"\n[[image]]\nunit = 1\nholding = 1\n')
        run = [*COMMAND, "run", "--control", str(tmp_path / "control.sock"), str(config)]
        with subprocess.Popen(
            _activated(run, door), pass_fds=[door.fileno()], stderr=subprocess.PIPE, text=True
        ) as gateway:
            for host in ("::1", "127.0.0.2", "127.0.0.1"):
                with socket.create_connection((host, port), timeout=PATIENCE) as client:
                    if host in served:
                        client.sendall(bytes.fromhex("0001 0000 0006 01 03 0000 0001"))
                        assert client.recv(260) == bytes.fromhex("0001 0000 0005 01 03 02 0000")
                    else:
                        assert client.recv(260) == b""
            gateway.terminate()
            log = gateway.communicate(timeout=PATIENCE)[1]
        assert f"tcp://{bind}:{port}" in log
        assert log.count(NOT_MEANT) == 3 - len(served)


def _activated(words: list[str], *sockets: socket.socket) -> list[str]:
    """The command, with these sockets as descriptors 3, 4, ..."""
    moves = " ".join(f"{3 + at}<&{sock.fileno()}" for at, sock in enumerate(sockets))
    command = " ".join(map(shlex.quote, words))
    return ["bash", "-c", f"LISTEN_FDS={len(sockets)} LISTEN_PID=$$ exec {command} {moves}"]
