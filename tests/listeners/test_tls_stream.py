"""One secured connection, without a network: between a client in memory and the session of a listener."""

import asyncio
import gc
import shutil
import socket
import ssl
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.listeners import kept_sessions
from gateway.listeners.connection import SecuredConnection
from gateway.listeners.handshakes import ConnectingClient, Handshakes
from gateway.listeners.settings import ListenSettings
from gateway.listeners.tls import TlsListener
from gateway.listeners.tls_stream import TlsStream
from gateway.modbus.mbap import encode
from gateway.request import Caller, Request, Target
from gateway.routing.access import EntryPoint
from gateway.routing.router import Router
from gateway.tls.contexts import load
from gateway.tls.settings import SecretFile, Secured, ServerTls
from gateway.tls.store import TlsStore
from kit.pki import OPERATOR, client_context, handshake_without_tickets, pki
from kit.router import router

READ, WRITE = bytes.fromhex("03 0000 0001"), bytes.fromhex("06 0000 0007")
CALLER = Caller("10.0.0.1:1", "10.0.0.1", "10.0.0.1")
CLIENT = ConnectingClient(CALLER)


class Network(asyncio.Transport):
    """The network's side of a stream: what was sent, and what was asked of it."""

    def __init__(self) -> None:
        super().__init__()
        self.sent = b""
        self.is_paused = False
        self.is_over = False
        #: What a look reads, if anything.
        self.connected: socket.socket | None = None

    def get_extra_info(self, name: str, default: object = None) -> object:
        return self.connected if name == "socket" else default

    def write(self, data: bytes) -> None:
        assert not self.is_over
        self.sent += data

    def pause_reading(self) -> None:
        self.is_paused = True

    def resume_reading(self) -> None:
        self.is_paused = False

    def is_closing(self) -> bool:
        return self.is_over

    def close(self) -> None:
        self.is_over = True

    def abort(self) -> None:
        self.is_over = True

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        pass

    def get_write_buffer_size(self) -> int:
        return 0


class Recorded:
    """A TLS connection whose handshake never ends, and that notes what is asked of it."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def wrap_bio(self, *_: object, **__: object) -> "Recorded":
        return self

    def __getattr__(self, name: str) -> Callable[[], None]:
        return lambda: self.asked.append(name)


class Listener:
    """Accepts everybody."""

    settings = ListenSettings("remote", "", 0, scheme="tls", in_flight=2)

    def __init__(self) -> None:
        self.rejections: list[str] = []

    def rejected(self, client: str, reason: str) -> None:
        self.rejections.append(reason)

    def connected(self, connection: object) -> None:
        pass

    closing = connected

    def left_early(self, host: str, waited: float) -> None:
        pass

    def closed(self, connection: object, reason: str) -> None:
        raise AssertionError(reason)

    def failed(self, part: str, error: Exception) -> None:
        raise error


class Slow(Target):
    """A target that answers when it is told to."""

    def __init__(self) -> None:
        self.waiting: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.waiting.append(request)

    def answer_first(self) -> None:
        self.waiting.pop(0).respond(bytes.fromhex("03 02 0007"))


class Peer:
    """A client in memory."""

    def __init__(self, version: ssl.TLSVersion) -> None:
        self.incoming, self.outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        context = client_context(OPERATOR)
        context.maximum_version = version
        self.tls = context.wrap_bio(self.incoming, self.outgoing, server_hostname="localhost")

    def goes_on(self) -> None:
        try:
            self.tls.do_handshake()
        except ssl.SSLWantReadError:
            return


def context() -> ssl.SSLContext:
    files = [SecretFile(str(pki() / name)) for name in ("server.crt", "server.key", "ca.crt")]
    return load(ServerTls(*files)).context


def arrive(stream: TlsStream, data: bytes) -> None:
    """As the event loop does it: into the buffer of the stream."""
    while data:
        room = stream.get_buffer(-1)
        count = min(len(room), len(data))
        room[:count] = data[:count]
        stream.buffer_updated(count)
        data = data[count:]


class Handshaker:
    """Does every step at once, and keeps what became of the stream."""

    def __init__(self, begin: Callable[[TlsStream], None]) -> None:
        self._begin = begin

    def step_due(self, stream: TlsStream) -> None:
        stream.stepped(stream.step())

    def secured(self, stream: TlsStream) -> None:
        self._begin(stream)

    def not_secured(self, stream: TlsStream, reason: str) -> None:
        raise AssertionError(reason)


def connected(
    target: Slow, version: ssl.TLSVersion = ssl.TLSVersion.TLSv1_3, listener: Listener | None = None
) -> tuple[Peer, TlsStream, Network]:
    now = asyncio.get_running_loop().time
    listener = listener or Listener()
    peer, network = Peer(version), Network()
    owner = Handshaker(lambda stream: stream.begin(SecuredConnection(listener, CALLER, now, target)))
    stream = TlsStream(context(), owner)
    stream.connection_made(network)
    stream.start()
    for _ in range(3):
        peer.goes_on()
        arrive(stream, peer.outgoing.read())
        peer.incoming.write(network.sent)
        network.sent = b""
    return peer, stream, network


def test_a_buffer_full_of_requests_is_not_taken_for_the_end() -> None:
    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.tls.write(b"".join(encode(number, 1, READ) for number in range(1000)))
        stream.pause_writing()
        arrive(stream, peer.outgoing.read())
        assert target.waiting == []
        stream.resume_writing()
        for number in range(1000):
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            assert target.waiting[0].transaction == number
            assert target.waiting[0].origin.takes_responses
            target.answer_first()
        assert not network.is_over

    asyncio.run(scenario())


def test_a_buffer_that_is_still_full_is_not_taken_for_the_end() -> None:
    """What arrives before the connection has gone on: the client would be cut off."""

    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.tls.write(b"".join(encode(number, 1, READ) for number in range(1000)))
        arrive(stream, peer.outgoing.read())
        stream._is_paused = False
        stream.buffer_updated(0)
        for number in range(1000):
            assert target.waiting[0].transaction == number
            target.answer_first()
            await asyncio.sleep(0)
            await asyncio.sleep(0)
        assert not network.is_over

    asyncio.run(scenario())


def test_what_a_look_leaves_behind_is_delivered() -> None:
    """Requests that arrive in the turn in which a response is ready: more of them than the session has room for."""

    async def scenario() -> None:
        target, answered = Slow(), list[int]()

        def answer(request: Request, _now: float) -> None:
            answered.append(request.transaction)
            request.respond(READ)

        peer, stream, network = connected(target)
        peer.tls.write(encode(0, 1, READ))
        arrive(stream, peer.outgoing.read())
        peer.tls.write(b"".join(encode(number, 1, READ) for number in range(1, 200)))
        network.connected, sending = socket.socketpair()
        network.connected.setblocking(False)
        sending.setblocking(False)
        with network.connected, sending:
            sending.send(peer.outgoing.read())
            target.answer_first()
            target.submit = answer  # type: ignore[method-assign]
            for _ in range(50):
                await asyncio.sleep(0)
        assert answered == list(range(1, 200))

    asyncio.run(scenario())


@pytest.mark.parametrize("in_tls", [True, False])
def test_what_a_look_leaves_behind_is_delivered_before_the_end_of_the_clients_side(*, in_tls: bool) -> None:
    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.tls.write(encode(500, 1, READ))
        arrive(stream, peer.outgoing.read())
        peer.tls.write(b"".join(encode(number, 1, READ) for number in range(200, 0, -1)))
        if in_tls:
            with pytest.raises(ssl.SSLError):
                peer.tls.unwrap()
        network.connected, sending = socket.socketpair()
        network.connected.setblocking(False)
        with network.connected, sending:
            sending.send(peer.outgoing.read())
            target.answer_first()
            if not in_tls:
                stream.eof_received()
            for number in range(200, 0, -1):
                for _ in range(4):
                    await asyncio.sleep(0)
                assert target.waiting[0].transaction == number
                target.answer_first()
        assert network.is_over

    asyncio.run(scenario())


def test_a_look_finds_an_identifier_that_comes_again_behind_other_records() -> None:
    """A client sends each request in a record of its own: the first one that waits does not tell alone."""

    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.tls.write(encode(7, 1, READ))
        arrive(stream, peer.outgoing.read())
        for number in (8, 7):
            peer.tls.write(encode(number, 1, READ))
        network.connected, sending = socket.socketpair()
        network.connected.setblocking(False)
        with network.connected, sending:
            sending.send(peer.outgoing.read())
            target.answer_first()
            for _ in range(4):
                await asyncio.sleep(0)
        assert network.sent == b""
        assert [request.transaction for request in target.waiting] == [8, 7]

    asyncio.run(scenario())


def test_what_is_answered_at_once_is_dropped_for_an_identifier_that_comes_again_behind_other_records() -> None:
    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.incoming.write(network.sent)
        network.sent = b""
        target.submit = lambda request, _: request.respond(request.pdu[:3])  # type: ignore[method-assign]
        network.connected, sending = socket.socketpair()
        network.connected.setblocking(False)
        for number, address in ((7, 1), (8, 2), (7, 3)):
            peer.tls.write(encode(number, 1, bytes((3, 0, address, 0, 1))))
        with network.connected, sending:
            arrive(stream, peer.outgoing.read())
            for _ in range(4):
                await asyncio.sleep(0)
        peer.incoming.write(network.sent)
        assert peer.tls.read(1000) == encode(8, 1, bytes((3, 0, 2))) + encode(7, 1, bytes((3, 0, 3)))

    asyncio.run(scenario())


def test_looks_never_leave_more_than_one_buffer_waiting() -> None:
    """A client that does not count, and sends more than is taken: it is read before each response."""

    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.tls.write(encode(0, 1, READ))
        arrive(stream, peer.outgoing.read())
        network.connected, sending = socket.socketpair()
        network.connected.setblocking(False)
        sending.setblocking(False)
        with network.connected, sending:
            for number in range(5000, 0, -1000):
                peer.tls.write(b"".join(encode(each, 1, READ) for each in range(number, number - 1000, -1)))
            assert sending.send(peer.outgoing.read()) > 3 * len(stream.get_buffer(-1))
            for _ in range(50):
                target.answer_first()
                for _ in range(4):
                    await asyncio.sleep(0)
                assert stream._incoming.pending <= len(stream.get_buffer(-1))

    asyncio.run(scenario())


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_client_may_send_each_byte_in_a_record_of_its_own(version: ssl.TLSVersion) -> None:
    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target, version)
        assert peer.tls.version() == version.name.replace("_", ".")
        for number in range(500):
            for byte in encode(number, 1, READ):
                peer.tls.write(bytes((byte,)))
            arrive(stream, peer.outgoing.read())
            assert target.waiting[0].transaction == number
            target.answer_first()
        assert not network.is_over

    asyncio.run(scenario())


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_client_is_told_what_was_wrong_with_a_record(version: ssl.TLSVersion) -> None:
    async def scenario() -> None:
        target, listener = Slow(), Listener()
        peer, stream, network = connected(target, version, listener)
        peer.tls.write(encode(1, 1, WRITE))
        record = bytearray(peer.outgoing.read())
        record[-1] ^= 1
        arrive(stream, record)
        assert target.waiting == []
        (reason,) = listener.rejections
        assert reason in {"decryption failed or bad record mac", "record layer failure"}  # as OpenSSL says it
        assert network.is_over
        peer.incoming.write(network.sent)
        with pytest.raises(ssl.SSLError, match="ALERT_BAD_RECORD_MAC"):
            peer.tls.read(1)

    asyncio.run(scenario())


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_client_is_told_what_was_wrong_with_a_record_that_a_look_has_read(version: ssl.TLSVersion) -> None:
    async def scenario() -> None:
        target, listener = Slow(), Listener()
        peer, stream, network = connected(target, version, listener)
        peer.tls.write(encode(1, 1, READ))
        arrive(stream, peer.outgoing.read())
        peer.tls.write(encode(2, 1, WRITE))
        record = bytearray(peer.outgoing.read())
        record[-1] ^= 1
        network.connected, sending = socket.socketpair()
        network.connected.setblocking(False)
        with network.connected, sending:
            sending.send(record)
            target.answer_first()
            await asyncio.sleep(0)
        (reason,) = listener.rejections
        assert reason in {"decryption failed or bad record mac", "record layer failure"}  # as OpenSSL says it
        assert network.is_over
        peer.incoming.write(network.sent)
        with pytest.raises(ssl.SSLError, match="ALERT_BAD_RECORD_MAC"):
            peer.tls.read(1)

    asyncio.run(scenario())


def test_what_comes_behind_the_end_of_the_clients_side_is_not_kept() -> None:
    async def scenario() -> None:
        target = Slow()
        peer, stream, network = connected(target)
        peer.tls.write(encode(1, 1, READ))
        with pytest.raises(ssl.SSLError):
            peer.tls.unwrap()
        arrive(stream, peer.outgoing.read())
        assert network.is_paused
        stream.pause_writing()
        stream.resume_writing()
        stream.resume_reading()
        assert network.is_paused
        target.answer_first()
        peer.incoming.write(network.sent)
        assert peer.tls.read(11)[7:] == bytes.fromhex("03 02 0007")
        assert network.is_over

    asyncio.run(scenario())


def test_what_a_thread_is_using_is_left_alone_when_the_connection_is_ended() -> None:
    async def scenario() -> None:
        tls, network, refused = Recorded(), Network(), []
        handshakes = Handshakes(lambda *_: None, lambda _, reason: refused.append(reason))
        handshakes.step_due = lambda _: None  # type: ignore[method-assign] # a step that takes long
        stream = TlsStream(tls, handshakes)  # type: ignore[arg-type]
        stream.connection_made(network)
        handshakes.begin(stream, CLIENT, 0.0)
        arrive(stream, b"hello")
        handshakes.sweep(100.0)
        assert network.is_over
        assert len(refused) == 1
        assert tls.asked == []
        stream.stepped(None)
        assert tls.asked == []

    asyncio.run(scenario())


def test_a_handshake_that_is_refused_is_not_ended_in_tls() -> None:
    """It would be of no use, and cost most of the time that a refusal takes."""

    async def scenario() -> None:
        tls, network = Recorded(), Network()
        handshakes = Handshakes(lambda *_: None, lambda *_: None)
        stream = TlsStream(tls, handshakes)  # type: ignore[arg-type]
        stream.connection_made(network)
        handshakes.begin(stream, CLIENT, 0.0)
        handshakes.sweep(100.0)
        assert network.is_over
        assert "unwrap" not in tls.asked

    asyncio.run(scenario())


def test_what_a_client_has_sent_before_its_handshake_begins_is_kept() -> None:
    """Python 3.11.2 of Debian 12 receives although the connection has said at once that it does not want to."""

    async def scenario() -> None:
        network, peer, due = Network(), Peer(ssl.TLSVersion.TLSv1_3), []
        handshakes = Handshakes(lambda *_: None, lambda *_: None)
        handshakes.step_due = due.append  # type: ignore[method-assign, assignment]
        stream = TlsStream(context(), handshakes)
        stream.connection_made(network)
        peer.goes_on()
        arrive(stream, peer.outgoing.read())
        assert due == []
        handshakes.begin(stream, CLIENT, 0.0)
        assert due == [stream]
        assert network.is_paused
        stream.stepped(stream.step())
        assert network.sent
        assert not network.is_paused

    asyncio.run(scenario())


def test_a_client_that_does_not_read_is_not_read() -> None:
    async def scenario() -> None:
        _, stream, network = connected(Slow())
        stream.pause_writing()
        assert network.is_paused
        stream.resume_writing()
        await asyncio.sleep(0)
        assert not network.is_paused

    asyncio.run(scenario())


@pytest.mark.parametrize("change", ["finish", "reload"])
def test_a_connection_that_has_just_been_accepted_is_ended_with_the_listener(change: str) -> None:
    async def scenario() -> None:
        tls = ServerTls(*[SecretFile(str(pki() / name)) for name in ("server.crt", "server.key", "ca.crt")])
        secured, store, network = Secured("listen remote", "", tls), TlsStore(), Network()
        store.adopt({secured: load(tls)})
        reaches = Router(EntryPoint("remote", "certified"), lambda: 0.0, lambda _: None)
        listener = TlsListener(replace(Listener.settings, tls=tls), reaches, lambda _: None, store)

        async def accepted(make: Callable[[], TlsStream], _: object) -> None:
            stream = make()
            if change == "finish":
                listener.finish()
            else:
                store.adopt({secured: load(tls)})
                listener.renew()
            stream.connection_made(network)

        asyncio.get_running_loop().connect_accepted_socket = accepted  # type: ignore[method-assign, assignment]
        with socket.socket() as sock:
            await listener._serve(sock, Caller("10.0.0.1:1", "10.0.0.1", "10.0.0.1"))
        if change == "reload":
            assert network.is_over

    asyncio.run(scenario())


def test_what_counts_as_a_clients_address_is_what_did_for_its_handshake() -> None:
    async def scenario() -> None:
        tls = ServerTls(*[SecretFile(str(pki() / name)) for name in ("server.crt", "server.key", "ca.crt")])
        store, begun = TlsStore(), list[SecuredConnection]()
        store.adopt({Secured("listen remote", "", tls): load(tls)})
        reaches = router({}, entry=EntryPoint("remote", "certified"))
        listener = TlsListener(replace(Listener.settings, tls=tls), reaches, lambda _: None, store)
        shown = ssl.PEM_cert_to_DER_cert((pki() / f"{OPERATOR}.crt").read_text())
        stream = SimpleNamespace(is_resumed=False, peer_certificate=shown, begin=begun.append)
        host = "2001:db8:1:2::7"
        listener._secured(stream, ConnectingClient(Caller(f"[{host}]:1", host, "2001:db8:1:2::/64")))  # type: ignore[arg-type]
        (connection,) = begun
        caller = connection.session.caller
        assert (caller.host, caller.share_key) == (host, "2001:db8:1:2::/64")
        assert (caller.subject, caller.role) == (f"CN={OPERATOR}", "operator")

    asyncio.run(scenario())


@pytest.mark.parametrize("most", [1, 0])
def test_a_session_beyond_the_bound_is_forgotten_with_its_connection(
    monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """Whatever the files are by now, of which another context would be made."""
    monkeypatch.setattr(kept_sessions, "MOST_AFTER_CLOSING", most)
    used = context()
    used.options |= ssl.OP_NO_TICKET
    monkeypatch.setattr(sys.modules[__name__], "context", lambda: used)

    async def scenario() -> None:
        _, stream, _ = connected(Slow(), ssl.TLSVersion.TLSv1_2)
        assert used.session_stats()["number"] == 1
        stream.close()

    asyncio.run(scenario())
    gc.collect()
    assert used.session_stats()["number"] == most


@pytest.mark.parametrize("change", ["none", "another certificate", "a damaged one"])
def test_sessions_are_forgotten_when_they_are_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    monkeypatch.setattr(kept_sessions, "MOST_SESSIONS", 2)
    for name in ("server.crt", "server.key", "ca.crt"):
        shutil.copy(pki() / name, tmp_path)
    settings = ServerTls(*[SecretFile(str(tmp_path / name)) for name in ("server.crt", "server.key", "ca.crt")])

    async def scenario() -> None:
        store = TlsStore()
        store.adopt({Secured("listen remote", "", settings): load(settings)})
        reaches = Router(EntryPoint("remote", "certified"), lambda: 0.0, lambda _: None)
        listener = TlsListener(replace(Listener.settings, tls=settings), reaches, lambda _: None, store)
        before = store[settings]
        for number in range(3):
            listener._kept.limit()
            assert listener._kept.renewing is None
            handshake_without_tickets(before.context)
            assert before.context.session_stats()["number"] == number + 1
        if change == "another certificate":
            for name in ("server.crt", "server.key"):
                shutil.copy(pki() / name.replace("server", OPERATOR), tmp_path / name)
        elif change == "a damaged one":
            (tmp_path / "server.crt").write_text("")
        listener._kept.limit()
        assert listener._kept.renewing is not None
        await asyncio.wait([listener._kept.renewing])
        await asyncio.sleep(0)
        assert (store[settings] is before) == (change != "none")
        assert listener._kept.renewing is None
        monkeypatch.setattr(kept_sessions, "MOST_SESSIONS", -1)
        listener._kept.limit()
        assert (listener._kept.renewing is None) == (change != "none")  # else there would be a thread for each sweep
        if change != "none":
            monkeypatch.setattr(listener._kept, "_next_at", asyncio.get_running_loop().time())
            listener._kept.limit()
        assert listener._kept.renewing is not None
        await asyncio.wait([listener._kept.renewing])

    asyncio.run(scenario())
