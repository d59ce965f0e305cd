"""An accepted TCP connection, on real sockets: what it promises its user, and what a session makes of it."""

import asyncio
import socket
import struct
import time
from contextlib import ExitStack, closing, suppress

import pytest

from gateway.errors import QueueFull
from gateway.listeners.connection import UNSENT_BYTES, TcpConnection, most_unsent
from gateway.listeners.holds import Holds
from gateway.listeners.settings import ListenSettings
from gateway.listeners.tcp_stream import TcpStream
from gateway.modbus.mbap import encode
from gateway.request import Caller, Request, Target
from kit.process import PATIENCE

READ, RESPONSE = bytes.fromhex("03 0000 0001"), bytes.fromhex("03 02 0007")
#: More than the system takes for a client that does not read.
A_LOT = 16 * 1024 * 1024
LIMIT = 4000


async def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "not within the time"
        await asyncio.sleep(0.002)


@pytest.fixture
def ends():
    """The gateway's end of a connection, and the client's."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = socket.create_connection(server.getsockname())
        accepted, _ = server.accept()
    accepted.setblocking(False)
    client.setblocking(False)
    with client, closing(accepted):
        yield accepted, client


def reset(client):
    """Leave as a process does that is killed with bytes unread."""
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def take(client):
    """What the client can read now, and whether that is all there will be."""
    taken = b""
    while True:
        try:
            data = client.recv(1 << 20)
        except BlockingIOError:
            return taken, False
        except ConnectionResetError:
            return taken, True
        if not data:
            return taken, True
        taken += data


class Slow(Target):
    """A target that answers when it is told to."""

    def __init__(self):
        self.waiting = []

    def submit(self, request: Request, now: float) -> None:
        self.waiting.append(request)


class Listener:
    """Notes what becomes of its connection."""

    def __init__(self, in_flight):
        self.settings = ListenSettings("scada", "127.0.0.1", 0, in_flight=in_flight)
        self.holds = Holds()
        self.failures = []
        self.reasons = []
        self.left = []

    def connected(self, connection):
        pass

    def closing(self, connection):
        pass

    def closed(self, connection, reason):
        self.reasons.append(reason)

    def rejected(self, client, reason):
        raise AssertionError(reason)

    def left_early(self, host, waited):
        self.left.append(host)

    def failed(self, part, error):
        self.failures.append((part, error))


class Served:
    """A client of a listener."""

    def __init__(self, accepted, target=None, in_flight=16):
        loop = asyncio.get_running_loop()
        self.target, self.listener = target or Slow(), Listener(in_flight)
        caller = Caller("127.0.0.1:1", "127.0.0.1", "127.0.0.1")
        self.connection = TcpConnection(self.listener, caller, loop.time, self.target)
        self.stream = TcpStream(loop, accepted, self.connection)
        self.connection.connection_made(self.stream)
        self.stream.resume_reading()


class User:
    """Notes what its stream tells it."""

    def __init__(self):
        self.buffer = bytearray(1000)
        self.heard = b""
        self.log = []
        self.losses = []
        self.hears = lambda: None
        self.reads_again = lambda: None

    def get_buffer(self):
        return memoryview(self.buffer)

    def buffer_updated(self, nbytes):
        self.heard += self.buffer[:nbytes]
        self.hears()

    def eof_received(self):
        self.log.append("end")
        return True

    def pause_writing(self):
        self.log.append("blocked")

    def resume_writing(self):
        self.log.append("free")
        self.reads_again()

    def connection_lost(self, exc):
        self.losses.append(exc)


@pytest.fixture(params=[pytest.param(User, id="noted", marks=pytest.mark.interpreted)])
def user(request):
    """Compiled, a stream takes no other user than a TcpConnection."""
    return request.param()


@pytest.fixture
async def stream(ends, user):
    stream = TcpStream(asyncio.get_running_loop(), ends[0], user)
    stream.set_write_buffer_limits(LIMIT)
    stream.resume_reading()
    yield stream
    stream.abort()
    await until(lambda: user.losses)


@pytest.fixture
def client(ends):
    return ends[1]


async def take_all(client):
    """What the client reads until the connection has ended."""
    taken = b""

    def has_ended():
        nonlocal taken
        data, is_over = take(client)
        taken += data
        return is_over

    await until(has_ended)
    return taken


# --- receiving ---


async def test_nothing_is_received_before_somebody_asks_for_it(ends, user):
    accepted, client = ends
    stream = TcpStream(asyncio.get_running_loop(), accepted, user)
    client.send(b"1")
    await asyncio.sleep(0.02)
    assert user.heard == b""
    stream.resume_reading()
    stream.resume_reading()
    await until(lambda: user.heard == b"1")
    stream.pause_reading()
    stream.pause_reading()
    client.send(b"2")
    await asyncio.sleep(0.02)
    assert user.heard == b"1"
    stream.resume_reading()
    await until(lambda: user.heard == b"12")
    stream.abort()
    await until(lambda: user.losses == [None])


async def test_a_connection_that_is_lost_in_a_pause_is_lost_at_once(stream, client, user):
    """Its requests wait no more, and it takes no turn among those that were refused."""
    watched = asyncio.get_running_loop()._selector.get_map()
    descriptor = stream._descriptor
    stream.pause_reading()
    assert descriptor in watched
    reset(client)
    await until(lambda: user.losses)
    assert descriptor not in watched
    assert isinstance(user.losses[0], ConnectionResetError)
    stream.resume_reading()
    assert len(user.losses) == 1


async def test_what_was_ready_before_a_pause_waits_for_its_end(stream, client, user):
    """The loop has found it readable, and somebody else pauses it before its turn."""
    await asyncio.sleep(0.02)
    client.send(b"1")
    asyncio.get_running_loop().call_soon(stream.pause_reading)
    await asyncio.sleep(0.02)
    assert (user.heard, user.losses) == (b"", [])
    stream.resume_reading()
    await until(lambda: user.heard == b"1")


async def test_what_has_arrived_can_be_taken_at_once(stream, client, user):
    stream.pause_reading()
    room = memoryview(bytearray(10))
    assert stream.receive(room) == 0
    client.send(b"ask")
    await until(lambda: stream.receive(room) == 3)
    assert bytes(room[:3]) == b"ask"
    client.send(b"again")
    stream.close()
    assert stream.receive(room) == 0


async def test_what_has_ended_leaves_alone_who_has_the_number_of_its_descriptor(ends, stream, client, user):
    number = ends[0].fileno()
    stream.abort()
    await until(lambda: user.losses)
    with ExitStack() as stack:
        for _ in range(100):
            there, here = (stack.enter_context(end) for end in socket.socketpair())
            if there.fileno() == number:
                break
            if here.fileno() == number:
                there, here = here, there
                break
        assert there.fileno() == number
        there.setblocking(False)
        here.setblocking(False)
        here.send(b"theirs")
        stream.write(b"ours")
        assert stream.receive(memoryview(bytearray(10))) == 0
        assert there.recv(10) == b"theirs"
        with pytest.raises(BlockingIOError):
            here.recv(10)


async def test_a_user_without_room_keeps_the_stream_waiting(stream, client, user):
    user.buffer = bytearray()
    client.send(b"ask")
    await asyncio.sleep(0.02)
    assert user.log == []
    user.buffer = bytearray(10)
    await until(lambda: user.heard == b"ask")


async def test_the_end_of_the_clients_side_is_told_once_and_the_client_still_gets_its_answers(stream, client, user):
    client.send(b"ask")
    client.shutdown(socket.SHUT_WR)
    await until(lambda: user.log == ["end"])
    assert user.heard == b"ask"
    stream.pause_reading()
    stream.resume_reading()
    await asyncio.sleep(0.02)
    assert (user.log, user.losses, stream.is_closing()) == (["end"], [], False)
    stream.write(b"answer")
    stream.close()
    assert await take_all(client) == b"answer"


async def test_the_end_is_left_to_the_loop_by_who_takes_what_has_arrived(stream, client, user):
    client.shutdown(socket.SHUT_WR)
    assert stream.receive(memoryview(bytearray(10))) == 0
    await until(lambda: user.log == ["end"])


# --- sending ---


async def test_what_the_client_does_not_take_follows_in_order(stream, client, user):
    data = bytes(range(256)) * (A_LOT // 256)
    stream.write(data)
    stream.write(b"the end")
    assert user.log == ["blocked"]
    stream.close()
    stream.write(b"never")
    assert stream.is_closing()
    assert user.losses == []
    assert await take_all(client) == data + b"the end"
    assert user.log == ["blocked", "free"]
    await until(lambda: user.losses == [None])


async def test_the_user_is_told_only_beyond_the_limit_and_again_at_a_quarter_of_it(stream, client, user):
    stream.set_write_buffer_limits(2 * A_LOT)
    stream.write(bytes(A_LOT))
    assert user.log == []
    stream.write(bytes(2 * A_LOT))
    assert user.log == ["blocked"]
    user.reads_again = lambda: left.append(len(stream._unsent))
    left = []
    await until(lambda: take(client) and left)
    assert left[0] <= A_LOT // 2


@pytest.mark.parametrize("call", ["close", "abort", "write"])
async def test_a_user_who_is_free_again_may_do_anything(stream, client, user, call):
    user.reads_again = {"close": stream.close, "abort": stream.abort, "write": lambda: stream.write(b"more")}[call]
    stream.write(bytes(A_LOT))
    await until(lambda: take(client) and "free" in user.log)
    stream.close()
    await until(lambda: take(client) and user.losses)
    assert user.losses == [None]


# --- the end ---


async def test_closing_is_told_once_and_never_inside_a_call(stream, user, client):
    stream.close()
    assert user.losses == []
    stream.close()
    stream.abort()
    await until(lambda: user.losses)
    await asyncio.sleep(0.02)
    assert user.losses == [None]
    stream.write(b"never")
    stream.resume_reading()
    stream.abort()
    assert await take_all(client) == b""


async def test_aborting_drops_what_was_not_sent(stream, client, user):
    stream.write(bytes(A_LOT))
    stream.abort()
    await until(lambda: user.losses == [None])
    assert len(await take_all(client)) < A_LOT


@pytest.mark.parametrize("doing", ["reading", "nothing", "sending", "taking"])
async def test_a_reset_is_a_loss_whatever_the_stream_is_doing(stream, client, user, doing):
    if doing in ("nothing", "taking"):
        stream.pause_reading()
    if doing == "sending":
        stream.write(bytes(A_LOT))
    reset(client)
    if doing == "nothing":
        await asyncio.sleep(0.02)
        for _ in range(2):
            stream.write(b"answer")
    if doing == "taking":  # as before each answer
        assert stream.receive(memoryview(bytearray(10))) == 0
        stream.write(b"answer")
    await until(lambda: user.losses)
    assert [type(loss) for loss in user.losses] == [ConnectionResetError]
    assert "end" not in user.log


# --- with a session ---


class AtOnce(Target):
    """A target that answers at once, as an image does, as much as an answer can hold."""

    def submit(self, request: Request, now: float) -> None:
        request.respond(bytes.fromhex("03 fa") + bytes(250))


async def test_a_client_that_reads_nothing_is_not_kept_more_than_it_is_promised(ends):
    accepted, client = ends
    served = Served(accepted, AtOnce())
    kept = [0]
    requests = b"".join(encode(number, 1, READ) for number in range(100))
    unsent = b""
    async with asyncio.timeout(PATIENCE):
        while served.connection.session._back_pressure.blocked_at is None:
            unsent = unsent or requests
            with suppress(BlockingIOError):
                unsent = unsent[client.send(unsent) :]
            await asyncio.sleep(0)
            kept.append(len(served.stream._unsent))
    assert 0 < max(kept) <= UNSENT_BYTES


async def test_a_client_with_much_in_progress_is_kept_as_much_as_it_has_asked_for(ends):
    accepted, client = ends
    served = Served(accepted, in_flight=1000)
    waiting = served.target.waiting
    kept = [0]
    async with asyncio.timeout(PATIENCE):
        while served.connection.session._back_pressure.blocked_at is None:
            unsent = b"".join(encode(number, 1, READ) for number in range(1000))
            while len(waiting) < 1000:
                with suppress(BlockingIOError):
                    unsent = unsent[client.send(unsent) :]
                await asyncio.sleep(0)
            while waiting:
                waiting.pop().respond(bytes.fromhex("03 fa") + bytes(250))
                kept.append(len(served.stream._unsent))
    assert UNSENT_BYTES < max(kept) <= most_unsent(1000)


async def test_a_client_that_resets_its_connection_has_lost_it(ends):
    accepted, client = ends
    served = Served(accepted)
    client.send(encode(1, 1, READ))
    await until(lambda: served.target.waiting)
    reset(client)
    assert served.connection.receive(memoryview(bytearray(10))) == 0
    await until(lambda: served.listener.reasons)
    assert served.listener.reasons[0].startswith("lost: ")


@pytest.mark.interpreted
@pytest.mark.parametrize("step", ["room", "received", "end_of_input", "block", "unblock", "proceed", "release"])
async def test_a_defect_anywhere_ends_the_connection_and_is_reported(ends, step):
    accepted, client = ends
    served = Served(accepted)
    connection = served.connection
    connection.session = Defective(connection.session, step)
    client.send(encode(1, 1, READ))
    match step:
        case "end_of_input":
            client.shutdown(socket.SHUT_WR)
        case "block" | "unblock":
            served.stream.write(bytes(A_LOT))
        case "proceed":
            connection.resume()
        case "release":
            connection.release_after(0.001)
    await until(lambda: take(client) and served.listener.reasons)
    [(part, error)] = served.listener.failures
    assert (part, type(error)) == ("client 127.0.0.1:1", ZeroDivisionError)
    assert served.listener.reasons == ["a defect in the gateway"]


@pytest.mark.interpreted
async def test_a_defect_while_a_connection_ends_is_reported_and_it_ends(ends):
    accepted, client = ends
    served = Served(accepted)
    served.connection.session = Defective(served.connection.session, "closed")
    reset(client)
    await until(lambda: served.listener.reasons)
    assert served.listener.reasons[0].startswith("lost: ")
    [(part, error)] = served.listener.failures
    assert (part, type(error)) == ("client 127.0.0.1:1", ZeroDivisionError)


class Defective:
    """A session of which one step is broken."""

    def __init__(self, session, step):
        self._session = session
        self._step = step

    def __getattr__(self, name):
        return self._fail if name == self._step else getattr(self._session, name)

    def _fail(self, *_):
        raise ZeroDivisionError


async def test_a_client_whose_waiting_request_was_displaced_goes_on(ends):
    """It is held back, and sends more than there is room for; that there is no room is no end of its side."""
    accepted, client = ends
    served = Served(accepted)
    target = served.target
    client.send(b"".join(encode(number, 1, READ) for number in range(2)))
    await until(lambda: len(target.waiting) == 2)
    target.waiting.pop(0).fail(QueueFull())
    client.send(b"".join(encode(number, 1, READ) for number in range(2, 200)))
    for number in range(1, 200):
        await until(lambda: target.waiting)
        assert target.waiting[0].transaction == number
        assert served.connection.session.takes_responses
        target.waiting.pop(0).respond(RESPONSE)
    assert served.listener.reasons == []


async def test_the_stream_of_a_session_without_room_is_not_at_its_end(ends):
    accepted, client = ends
    served = Served(accepted)
    client.send(b"".join(encode(number, 1, READ) for number in range(200)))
    await until(lambda: len(served.target.waiting) == 16)
    served.stream.resume_reading()  # before the session has gone on
    await asyncio.sleep(0.02)
    assert served.connection.session.takes_responses
