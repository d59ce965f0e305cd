"""The real UDP listener on real sockets: one datagram, one request, one response, to the one who sent it."""

import asyncio
import dataclasses
import gc
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, suppress
from ipaddress import ip_network
from itertools import pairwise

import pytest

from gateway.errors import ListenError
from gateway.events import AccessDenied, ClientClosed, ClientConnected, ClientRejected, Event, ListenerUp, PartFailed
from gateway.listeners import udp as udp_module
from gateway.listeners.admission import NO_RIGHTS, NOT_MEANT
from gateway.listeners.sessions.peer import Peer
from gateway.listeners.settings import ListenSettings
from gateway.listeners.sockets import OpenSockets
from gateway.listeners.tcp import TcpListener
from gateway.listeners.udp import UdpListener
from gateway.modbus.mbap import encode
from gateway.request import NamedTarget, Request
from gateway.routing.access import EVERYTHING, AccessRow, EntryPoint
from gateway.routing.rights import Rights
from kit.ipv6 import needs_ipv6
from kit.process import PATIENCE
from kit.router import router

#: Units of the scripted target.
PROMPT, PATIENT, DEFECTIVE, UNKNOWN = 1, 2, 3, 4
READ = bytes.fromhex("03 0000 007D")
OTHER_READ = bytes.fromhex("03 1000 0001")
WRITE = bytes.fromhex("06 0000 0001")
RESPONSE = bytes.fromhex("03 FA") + bytes(250)
OTHER_RESPONSE = bytes.fromhex("03 02 01 10")
SWEEP = 0.02
#: How long nothing must come for a test to believe that nothing will, in seconds.
SILENCE = 0.15


@pytest.fixture(autouse=True)
def _in_a_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_module, "SWEEP_STEP", SWEEP)


class Plant(NamedTarget):
    """A target that answers PROMPT at once, keeps requests to PATIENT, and has a defect in DEFECTIVE."""

    def __init__(self) -> None:
        self.name = "plant"
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)
        if request.unit == DEFECTIVE:
            raise RuntimeError("nobody foresaw this")
        if request.unit == PROMPT:
            request.respond(RESPONSE)


class Client:
    """A Modbus UDP client."""

    def __init__(self, port: int, host: str = "127.0.0.1", *, own: str | None = None) -> None:
        self.socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        if own:
            self.socket.bind((own, 0))
        self.socket.connect((host, port))
        self.socket.setblocking(False)
        host, port = self.socket.getsockname()[:2]
        self.name = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def ask(self, unit: int = PROMPT, transaction: int = 1, pdu: bytes = READ) -> None:
        self.send(encode(transaction, unit, pdu))

    def send(self, datagram: bytes) -> None:
        self.socket.send(datagram)

    async def hears(self) -> bytes:
        """The next datagram."""
        async with asyncio.timeout(PATIENCE):
            return await asyncio.get_running_loop().sock_recv(self.socket, 2048)

    async def asks(self, unit: int = PROMPT, transaction: int = 1, pdu: bytes = READ) -> bytes:
        self.ask(unit, transaction, pdu)
        return await self.hears()

    async def hears_nothing(self) -> bool:
        await asyncio.sleep(SILENCE)
        try:
            self.socket.recv(2048)
        except BlockingIOError:
            return True
        return False


class Bench:
    """A listener that takes datagrams, and what it tells."""

    def __init__(self, settings: ListenSettings) -> None:
        self.plant = Plant()
        self.events: list[Event] = []
        routes = dict.fromkeys((PROMPT, PATIENT, DEFECTIVE), self.plant)
        made = router(routes, self.events.append, entry=EntryPoint("field", "datagram"))
        self.listener = UdpListener(settings, made, self.events.append)
        self.clients: list[Client] = []

    @property
    def port(self) -> int:
        return int(self.listener.address.rsplit(":", 1)[1])

    def client(self, host: str = "127.0.0.1", own: str | None = None) -> Client:
        self.clients.append(Client(self.port, host, own=own))
        return self.clients[-1]

    def told(self, kind: type[Event]) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]


@asynccontextmanager
async def listening(
    clients: int = 32,
    idle: float = 0,
    in_flight: int = 16,
    host: str = "127.0.0.1",
    ready: socket.socket | None = None,
) -> AsyncIterator[Bench]:
    """A listener at `host`; with a `ready` socket of systemd, at its port."""
    port = ready.getsockname()[1] if ready else 0
    bench = Bench(ListenSettings("field", host, port, clients=clients, idle=idle, in_flight=in_flight, scheme="udp"))
    await bench.listener.find()
    bench.listener.bind(OpenSockets([ready] if ready else []))
    bench.listener.listen()
    bench.listener.start()
    try:
        yield bench
    finally:
        bench.listener.close()
        for client in bench.clients:
            client.socket.close()


async def bound_as(bench: Bench, ready: OpenSockets, **changes: object) -> UdpListener:
    """Another listener of the bench's port, which does not read yet."""
    settings = dataclasses.replace(bench.listener.settings, port=bench.port, **changes)
    made = UdpListener(settings, bench.listener.router, bench.events.append)
    await made.find()
    made.bind(ready)
    return made


async def follower(bench: Bench, **changes: object) -> UdpListener:
    """What a reload puts in the place of the listener."""
    later = await bound_as(bench, OpenSockets(leaving=bench.listener.sockets), **changes)
    replace(bench.listener, later)
    return later


def replace(listener: UdpListener, later: UdpListener) -> None:
    listener.close()
    later.start()


async def until(condition: Callable[[], object]) -> None:
    """Wait for something that should come."""
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - plain calls set no event
            await asyncio.sleep(0.002)


async def test_each_datagram_gets_its_response() -> None:
    async with listening() as bench:
        one, other = bench.client(), bench.client()
        for transaction in range(100):
            assert await one.asks(transaction=transaction) == encode(transaction, PROMPT, RESPONSE)
            assert await other.asks(transaction=transaction) == encode(transaction, PROMPT, RESPONSE)
        assert bench.told(ListenerUp) == [ListenerUp("field", f"udp://127.0.0.1:{bench.port}")]
        assert bench.told(ClientConnected) == [ClientConnected("field", each.name) for each in (one, other)]
        assert bench.listener.clients == bench.listener.counts.accepted == 2


async def test_a_forged_datagram_is_amplified_as_much_as_docs_operations_says() -> None:
    async with listening() as bench:
        answer = await bench.client().asks()
        assert round(len(answer) / len(encode(1, PROMPT, READ)), 1) == 21.6


async def test_a_response_comes_to_the_one_who_asked_and_from_where_it_was_asked() -> None:
    """A connected socket takes datagrams from that address only; the listener is bound to all of them."""
    async with listening(host="0.0.0.0") as bench:
        for number in range(1, 6):
            client = bench.client(f"127.0.0.{number}", own=f"127.0.1.{number}")
            assert await client.asks() == encode(1, PROMPT, RESPONSE)


async def test_one_client_that_asks_two_of_our_addresses_is_answered_from_each() -> None:
    async with listening(host="0.0.0.0") as bench:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.settimeout(PATIENCE)
            client.bind(("127.0.0.1", 0))
            for host in ("127.0.0.2", "127.0.0.3", "127.0.0.2"):
                client.sendto(encode(1, PROMPT, READ), (host, bench.port))
                assert await asyncio.to_thread(client.recvfrom, 512) == (
                    encode(1, PROMPT, RESPONSE),
                    (host, bench.port),
                )


@pytest.fixture
def everywhere() -> Iterator[socket.socket]:
    """A socket of systemd for `ListenDatagram=[::]:P`: IPv6 and IPv4."""
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        sock.bind(("::", 0))
        yield sock


@needs_ipv6
@pytest.mark.parametrize(
    ("host", "meant", "others"),
    [
        ("0.0.0.0", ["127.0.0.1", "127.0.0.2"], ["::1"]),
        ("127.0.0.1", ["127.0.0.1"], ["127.0.0.2", "::1"]),
        ("::1", ["::1"], ["127.0.0.1"]),
        ("::", ["127.0.0.1", "::1"], []),
    ],
)
async def test_a_socket_of_systemd_at_every_address_serves_those_of_the_listener(
    everywhere: socket.socket, host: str, meant: list[str], others: list[str]
) -> None:
    async with listening(host=host, ready=everywhere) as bench:
        strangers = [bench.client(each) for each in others]
        for stranger in strangers:
            stranger.ask()
        for each in meant:
            assert await bench.client(each).asks() == encode(1, PROMPT, RESPONSE)
        assert [await stranger.hears_nothing() for stranger in strangers] == [True] * len(others)
        assert (bench.listener.counts.accepted, bench.listener.counts.rejected) == (len(meant), len(others))
        told = bench.told(ClientRejected)
        assert told == [ClientRejected("field", stranger.name, NOT_MEANT) for stranger in strangers]
        assert len(bench.plant.requests) == len(meant)


@needs_ipv6
async def test_no_wider_socket_serves_an_address_on_one_interface(everywhere: socket.socket) -> None:
    """A datagram tells which address it was sent to, and not on which interface that is."""
    port = everywhere.getsockname()[1]
    ready = OpenSockets([everywhere])
    assert ready.take_wider(socket.SOCK_DGRAM, ("fe80::1%lo", port, 0, 1)) is None


MALFORMED = {
    "empty": b"",
    "half a header": bytes.fromhex("0001 0000 00"),
    "no function": bytes.fromhex("0001 0000 0001 01"),
    "another protocol": bytes.fromhex("0001 0001 0006 01 03 0000 0001"),
    "a length too short": bytes.fromhex("0001 0000 0005 01 03 0000 0001"),
    "a length too long": bytes.fromhex("0001 0000 0007 01 03 0000 0001"),
    "two requests": 2 * encode(1, PROMPT, READ),
    "too much": encode(1, PROMPT, READ) + bytes(500),
    "one byte behind the largest": encode(1, PROMPT, READ + bytes(248)) + b"\0",
    "an exception response": encode(1, PROMPT, b"\x83\x02"),
    "text": b"GET / HTTP/1.1\r\n\r\n",
    "the largest datagram": bytes(65507),
}


async def test_what_is_not_one_request_is_dropped_and_counted() -> None:
    async with listening() as bench:
        client = bench.client()
        for datagram in MALFORMED.values():
            client.send(datagram)
        assert await client.asks(transaction=9) == encode(9, PROMPT, RESPONSE)
        assert await client.hears_nothing()
        assert bench.listener.counts.malformed == len(MALFORMED)
        assert len(bench.plant.requests) == 1


async def test_nobody_may_write_and_an_unknown_unit_is_0a() -> None:
    async with listening() as bench:
        client = bench.client()
        assert await client.asks(pdu=WRITE) == encode(1, PROMPT, b"\x86\x01")
        assert await client.asks(UNKNOWN) == encode(1, UNKNOWN, b"\x83\x0a")
        assert bench.told(AccessDenied) == [AccessDenied("field", client.name, PROMPT, 6)]
        assert bench.plant.requests == []


async def test_a_datagram_that_is_repeated_is_executed_once() -> None:
    async with listening() as bench:
        client = bench.client()
        for _ in range(5):
            client.ask(PATIENT)
        assert await client.asks(transaction=2) == encode(2, PROMPT, RESPONSE)
        [request, _] = bench.plant.requests
        request.respond(RESPONSE)
        assert await client.hears() == encode(1, PATIENT, RESPONSE)
        assert await client.hears_nothing()


async def test_beyond_in_flight_the_answer_is_busy() -> None:
    async with listening(in_flight=3) as bench:
        client, other = bench.client(), bench.client()
        for transaction in range(3):
            client.ask(PATIENT, transaction)
        assert await client.asks(PROMPT, 3) == encode(3, PROMPT, b"\x83\x06")
        assert await other.asks() == encode(1, PROMPT, RESPONSE)
        assert len(bench.plant.requests) == 4


async def test_the_ports_of_one_address_take_turns_as_one() -> None:
    """C15, and what counts as one address is as at the admission of clients."""
    async with listening() as bench:
        bench.listener._share_keys.of = lambda host, now: host.removesuffix(".9")  # type: ignore[method-assign]
        for own in ("127.0.0.1", "127.0.0.1", "127.0.0.9"):
            bench.client(own=own).ask(PATIENT)
        await until(lambda: len(bench.plant.requests) == 3)
        one, same, other = (request.caller for request in bench.plant.requests)
        assert one.share_key == same.share_key == "127.0.0.1"
        assert one.client != same.client
        assert (other.share_key, other.host) == ("127.0.0", "127.0.0.9")


async def test_many_forged_senders_leave_no_more_than_the_bound() -> None:
    """And a peer with a request under way is not forgotten for them; nor is that of another address."""
    async with listening(clients=4) as bench:
        busy, good = bench.client(own="127.0.0.2"), bench.client(own="127.0.0.3")
        busy.ask(PATIENT)
        await good.asks()
        for _ in range(100):
            forged = bench.client(own="127.0.0.4")
            await forged.asks()
        assert bench.listener.clients == 4
        assert not [event for event in bench.told(ClientClosed) if event.client in (busy.name, good.name)]
        bench.plant.requests[0].respond(RESPONSE)
        assert await busy.hears() == encode(1, PATIENT, RESPONSE)


async def test_everybody_has_a_turn_between_the_admissions_of_two_peers() -> None:
    """To find a place takes a millisecond where there are many clients: many senders must not stall all listeners."""
    async with listening(clients=4) as bench:
        clients, counts, seen = [bench.client() for _ in range(50)], bench.listener.counts, [0]
        for client in clients:
            client.ask()
        async with asyncio.timeout(PATIENCE):
            while seen[-1] < len(clients):
                await asyncio.sleep(0)
                seen.append(counts.accepted + counts.rejected)
        assert max(after - before for before, after in pairwise(seen)) == 1


@pytest.mark.interpreted
async def test_of_many_new_peers_only_so_many_wait_and_known_ones_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """What one of them sends again still replaces what it has given up."""
    monkeypatch.setattr(udp_module, "MOST_AT_ONCE", 3)
    async with listening() as bench:
        known, new = bench.client(), [bench.client() for _ in range(4)]
        await known.asks()
        for client in (*new[:3], new[0]):
            client.ask(PATIENT)
        new[0].ask(PATIENT, 1, OTHER_READ)
        new[3].ask(PATIENT)
        known.ask(PROMPT, 2)
        for _ in range(3):
            bench.listener._readable(bench.listener.sockets[0])
        assert await known.hears() == encode(2, PROMPT, RESPONSE)
        assert [event.client for event in bench.told(ClientRejected)] == [new[3].name]
        await until(lambda: len(bench.plant.requests) == 2 + 3)
        assert [request.pdu for request in bench.plant.requests[2:]] == [OTHER_READ, READ, READ]


@pytest.mark.interpreted
async def test_who_has_no_rights_keeps_no_new_peer_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_module, "MOST_AT_ONCE", 3)
    async with listening() as bench:
        row = AccessRow(EVERYTHING, (ip_network("127.0.0.1"),), listeners=frozenset({"field"}))
        bench.listener.router.rights = Rights((row,), EntryPoint("field", "datagram"))
        for client in [bench.client(own="127.0.0.66") for _ in range(3)]:
            client.ask()
        entitled = bench.client()
        entitled.ask()
        for _ in range(2):
            bench.listener._readable(bench.listener.sockets[0])
        assert await entitled.hears() == encode(1, PROMPT, RESPONSE)
        assert {event.reason for event in bench.told(ClientRejected)} == {NO_RIGHTS}


async def test_when_all_are_busy_the_datagram_of_another_one_is_dropped() -> None:
    async with listening(clients=1) as bench:
        busy, other = bench.client(), bench.client()
        busy.ask(PATIENT)
        other.ask()
        assert await other.hears_nothing()
        reason = "too many clients, and all of them have requests in progress"
        assert bench.told(ClientRejected) == [ClientRejected("field", other.name, reason)]
        assert bench.listener.counts.rejected == 1
        bench.plant.requests[0].respond(RESPONSE)
        assert await other.asks() == encode(1, PROMPT, RESPONSE)
        assert [event.reason for event in bench.told(ClientClosed)] == ["made room for another client"]


async def test_a_peer_that_asks_nothing_is_forgotten_and_a_busy_one_is_not() -> None:
    async with listening(idle=0.1) as bench:
        busy, idle = bench.client(), bench.client()
        busy.ask(PATIENT)
        await idle.asks()
        await until(lambda: bench.told(ClientClosed))
        await asyncio.sleep(SILENCE)
        assert bench.told(ClientClosed) == [ClientClosed("field", idle.name, "idle")]
        assert await idle.asks() == encode(1, PROMPT, RESPONSE)


async def test_a_defect_is_told_and_the_next_datagram_is_answered() -> None:
    async with listening() as bench:
        client = bench.client()
        client.ask(DEFECTIVE)
        assert await client.asks(transaction=2) == encode(2, PROMPT, RESPONSE)
        [told] = bench.told(PartFailed)
        assert told.part == f"client {client.name}"
        assert "nobody foresaw this" in told.traceback


async def test_a_client_that_has_gone_is_nobodys_trouble() -> None:
    """The system hears that nobody takes the response, and may tell so at the next datagram."""
    async with listening() as bench:
        gone, client = bench.client(), bench.client()
        gone.ask(PATIENT)
        await until(lambda: bench.plant.requests)
        gone.socket.close()
        bench.plant.requests[0].respond(RESPONSE)
        for transaction in range(3):
            assert await client.asks(transaction=transaction) == encode(transaction, PROMPT, RESPONSE)


async def test_a_listener_that_finishes_answers_what_is_under_way_and_takes_no_more() -> None:
    async with listening() as bench:
        client = bench.client()
        client.ask(PATIENT)
        await until(lambda: bench.plant.requests)
        bench.listener.finish()
        assert bench.listener.has_clients
        client.ask(PROMPT, 2)
        bench.plant.requests[0].respond(RESPONSE)
        assert await client.hears() == encode(1, PATIENT, RESPONSE)
        assert await client.hears_nothing()
        assert not bench.listener.has_clients


BINDS = [
    ("127.0.0.1", "127.0.0.1"),
    ("0.0.0.0", "127.0.0.1"),
    ("127.0.0.1", "0.0.0.0"),
    pytest.param("::", "127.0.0.1", marks=needs_ipv6),
    pytest.param("127.0.0.1", "::", marks=needs_ipv6),
    pytest.param("::", "0.0.0.0", marks=needs_ipv6),
    pytest.param("0.0.0.0", "::", marks=needs_ipv6),
]


@pytest.mark.parametrize(("before", "after"), BINDS)
async def test_a_reload_drops_what_is_in_progress_and_a_client_that_asks_again_is_answered(
    before: str, after: str
) -> None:
    async with listening(host=before) as bench:
        client = bench.client()
        client.ask(PATIENT)
        await until(lambda: bench.plant.requests)
        later = await follower(bench, host=after)
        assert not bench.listener.has_clients
        assert bench.told(ClientClosed) == [ClientClosed("field", client.name, "the gateway is stopping")]
        client.ask(PATIENT, 1, OTHER_READ)
        await until(lambda: len(bench.plant.requests) == 2)
        given_up, awaited = bench.plant.requests
        assert not given_up.origin.wants(given_up)
        given_up.respond(RESPONSE)
        awaited.respond(OTHER_RESPONSE)
        assert await client.hears() == encode(1, PATIENT, OTHER_RESPONSE)
        assert await client.hears_nothing()
        later.close()


async def test_from_reload_to_reload_nothing_is_left_of_peers_that_are_over() -> None:
    others = peers()
    async with listening() as bench:
        for number in range(4):
            bench.client().ask(PATIENT)
            await until(lambda: len(bench.plant.requests) == number + 1)  # noqa: B023
            bench.listener = await follower(bench)
        while bench.plant.requests:
            bench.plant.requests.pop().respond(RESPONSE)
        await until(lambda: peers() <= others)


def peers() -> set[int]:
    """Those in memory."""
    gc.collect()
    return {id(each) for each in gc.get_objects() if isinstance(each, Peer)}


async def test_of_datagrams_that_waited_with_one_identifier_the_latest_is_answered() -> None:
    """The process stood still, or was busy: the client has had its time-out meanwhile."""
    async with listening() as bench:
        client, other = bench.client(), bench.client()
        for _ in range(2):
            client.ask(PROMPT, 0)
        client.ask(PROMPT, 7)
        other.ask(PROMPT, 0)
        client.ask(PATIENT, 0, OTHER_READ)
        assert await client.hears() == encode(7, PROMPT, RESPONSE)
        assert await other.hears() == encode(0, PROMPT, RESPONSE)
        await until(lambda: len(bench.plant.requests) == 3)
        [late] = [request for request in bench.plant.requests if request.pdu == OTHER_READ]
        late.respond(OTHER_RESPONSE)
        assert await client.hears() == encode(0, PATIENT, OTHER_RESPONSE)
        assert await client.hears_nothing()


async def test_a_response_is_dropped_for_a_later_request_that_was_not_read_yet() -> None:
    """As when the process stood still: the response of the unit is read first."""
    async with listening() as bench:
        client = bench.client()
        client.ask(PATIENT, 0)
        await until(lambda: bench.plant.requests)
        client.ask(PATIENT, 0, OTHER_READ)
        bench.plant.requests[0].respond(RESPONSE)
        await until(lambda: len(bench.plant.requests) == 2)
        bench.plant.requests[1].respond(OTHER_RESPONSE)
        assert await client.hears() == encode(0, PATIENT, OTHER_RESPONSE)


@pytest.mark.parametrize("pdu", [READ, OTHER_READ])
async def test_a_datagram_repeated_just_before_its_response_is_executed_once(pdu: bytes) -> None:
    """It is read before the response leaves, and processed after that."""
    async with listening() as bench:
        client = bench.client()
        client.ask(PATIENT, 1, pdu)
        await until(lambda: bench.plant.requests)
        client.ask(PATIENT, 1, pdu)
        bench.plant.requests[0].respond(OTHER_RESPONSE)
        assert await client.hears() == encode(1, PATIENT, OTHER_RESPONSE)
        assert await client.asks(PROMPT, 2) == encode(2, PROMPT, RESPONSE)
        assert [request.transaction for request in bench.plant.requests] == [1, 2]
        client.ask(PATIENT, 1, pdu)  # after the response it is another one
        await until(lambda: len(bench.plant.requests) == 3)


@pytest.mark.parametrize("given_up", [1, 2])
async def test_a_response_that_is_ready_at_once_is_dropped_for_a_later_request(given_up: int) -> None:
    """Which comes while datagrams are processed: it replaces one that still waits, too."""
    async with listening() as bench:
        client, submit = bench.client(), bench.plant.submit

        def stand_still(request: Request, now: float) -> None:
            bench.plant.submit = submit  # type: ignore[method-assign]
            client.ask(PATIENT, given_up, OTHER_READ)
            submit(request, now)

        bench.plant.submit = stand_still  # type: ignore[method-assign]
        client.ask(PROMPT, 1)
        client.ask(PROMPT, 2)
        assert await client.hears() == encode(3 - given_up, PROMPT, RESPONSE)
        await until(lambda: bench.plant.requests[-1].unit == PATIENT)
        bench.plant.requests[-1].respond(OTHER_RESPONSE)
        assert await client.hears() == encode(given_up, PATIENT, OTHER_RESPONSE)
        assert [request.transaction for request in bench.plant.requests].count(2) == 1


@pytest.mark.interpreted  # what a compiled listener reads cannot be watched
async def test_no_more_datagrams_than_a_bound_are_read_before_the_first_is_processed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nor while they are processed, when others are read before each response: nothing else bounds what is kept."""
    monkeypatch.setattr(udp_module, "MOST_AT_ONCE", 3)
    async with listening() as bench:
        client, read, kept = bench.client(), bench.listener._read, []

        def reads(sock: socket.socket) -> None:
            read(sock)
            kept.append(len(bench.listener._arrived))

        monkeypatch.setattr(bench.listener, "_read", reads)
        for transaction in range(8):
            client.ask(PROMPT, transaction)
        heard = [await client.hears() for _ in range(8)]
        assert heard == [encode(transaction, PROMPT, RESPONSE) for transaction in range(8)]
        assert max(kept) == 3


async def test_a_listener_that_closes_forgets_everybody() -> None:
    async with listening() as bench:
        client = bench.client()
        client.ask(PATIENT)
        await until(lambda: bench.plant.requests)
        bench.listener.close()
        assert not bench.plant.requests[0].origin.wants(bench.plant.requests[0])
        assert bench.told(ClientClosed) == [ClientClosed("field", client.name, "the gateway is stopping")]
        bench.plant.requests[0].respond(RESPONSE)
        assert bench.listener.address == "udp://127.0.0.1:0"


async def test_two_listeners_on_one_port_are_an_error_in_words() -> None:
    async with listening() as bench:
        settings = ListenSettings("second", "127.0.0.1", bench.port, source="gateway.toml:7", scheme="udp")
        second = UdpListener(settings, bench.listener.router, bench.events.append)
        await second.find()
        with pytest.raises(ListenError, match=r"gateway\.toml:7: cannot listen on udp://127\.0\.0\.1:\d+: another"):
            second.bind()


async def test_udp_and_tcp_may_have_the_same_port() -> None:
    async with listening() as bench:
        tcp = TcpListener(ListenSettings("tcp", "127.0.0.1", 0), bench.listener.router, bench.events.append)
        await tcp.find()
        tcp.bind()
        port = int(tcp.address.rpartition(":")[2])
        settings = ListenSettings("udp", "127.0.0.1", port, scheme="udp")
        udp = UdpListener(settings, bench.listener.router, bench.events.append)
        with suppress(ListenError):  # a client of another program may have this port by chance
            await udp.find()
            udp.bind()
            assert udp.address == f"udp://127.0.0.1:{port}"
        udp.close()
        tcp.close()


@needs_ipv6
async def test_an_ipv6_listener_takes_ipv4_clients_who_look_like_such() -> None:
    """C15."""
    async with listening(host="::") as bench:
        old, older, new = bench.client("127.0.0.1"), bench.client("127.0.0.9"), bench.client("::1")
        for client in (old, older, new):
            assert await client.asks() == encode(1, PROMPT, RESPONSE)
        assert [event.client for event in bench.told(ClientConnected)] == [old.name, older.name, new.name]
