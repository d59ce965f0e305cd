"""What the loop asks of the kernel for each request: the same in Python and in C, and in C on an older kernel."""

import gc
import os
import resource
import select
import signal
import socket
import sys
import threading
import time
import tracemalloc
from contextlib import ExitStack, closing
from itertools import pairwise, repeat

import pytest

from gateway.clock.system_calls import EXACT_PART, MOST_FOUND, MOST_READ, SELECTABLE
from kit.process import PATIENCE

pytest_plugins = ["kit.system_calls"]

#: More than the system takes for somebody who does not read.
A_LOT = bytes(16 * 1024 * 1024)
NO_DESCRIPTOR = 1 << 20


@pytest.fixture
def pair():
    near, far = socket.socketpair()
    with near, far:
        for end in (near, far):
            end.setblocking(False)
        yield near, far


@pytest.fixture
def terminal():
    """A terminal that does not block, and what is behind it."""
    behind, near = os.openpty()
    os.set_blocking(near, False)
    with ExitStack() as stack:
        stack.callback(os.close, near)
        yield near, behind


@pytest.fixture
def epoll():
    with closing(select.epoll()) as epoll:
        yield epoll


def test_what_has_come_is_read(calls, pair):
    near, far = pair
    far.send(b"abcdef")
    assert calls.read(near.fileno(), 4) == b"abcd"
    assert calls.read(near.fileno(), 4) == b"ef"


def test_where_nothing_has_come_there_is_none_and_at_the_end_there_is_nothing(calls, pair):
    near, far = pair
    assert calls.read(near.fileno(), 4) is None
    far.close()
    assert calls.read(near.fileno(), 4) == b""


def test_no_more_is_read_than_one_read_may(calls, pair):
    near, far = pair
    far.send(bytes(MOST_READ + 1))
    assert calls.read(near.fileno(), MOST_READ) == bytes(MOST_READ)
    assert calls.read(near.fileno(), MOST_READ) == b"\0"


def test_what_has_come_is_read_into_what_has_room(calls, pair):
    near, far = pair
    room = bytearray(8)
    far.send(b"abcdef")
    assert calls.read_into(near.fileno(), memoryview(room)[1:5]) == 4
    assert calls.read_into(near.fileno(), room) == 2
    assert room == b"efbcd\0\0\0"


def test_where_nothing_has_come_nothing_is_read_into_it(calls, pair):
    near, far = pair
    room = bytearray(b"kept")
    assert calls.read_into(near.fileno(), room) == -1
    far.close()
    assert calls.read_into(near.fileno(), room) == 0
    assert room == b"kept"


def test_the_room_can_be_changed_afterwards(calls, pair):
    """A buffer that is still held could not grow."""
    near, far = pair
    room = bytearray(1)
    far.send(b"a")
    calls.read_into(near.fileno(), room)
    calls.write(near.fileno(), room)
    room.extend(b"more")
    assert room == b"amore"


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_what_is_written_arrives(calls, pair, kind):
    near, far = pair
    assert calls.write(near.fileno(), kind(b"abcdef")) == 6
    assert far.recv(10) == b"abcdef"


def test_what_is_not_taken_is_told(calls, pair):
    near, _ = pair
    taken = calls.write(near.fileno(), A_LOT)
    assert 0 < taken < len(A_LOT)
    assert calls.write(near.fileno(), A_LOT) == 0


def test_a_terminal_is_read_and_written(calls, terminal):
    near, behind = terminal
    with closing(open(behind, "rb+", buffering=0)):  # noqa: PTH123 - a descriptor
        assert calls.read(near, 256) is None
        assert calls.write(near, b"abc") == 3
        assert os.read(behind, 10) == b"abc"
        os.write(behind, b"line\n")
        assert calls.read(near, 256) == b"line\n"


def test_a_terminal_that_is_hung_up_has_come_to_its_end_and_takes_nothing(calls, terminal):
    near, behind = terminal
    os.close(behind)
    assert calls.read(near, 256) == b""
    with pytest.raises(OSError, match=r"\[Errno 5\]"):
        calls.write(near, b"x")


def test_the_error_of_a_lost_connection_is_that_of_python(calls):
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname())
        far, _ = server.accept()
    with near:
        near.setblocking(False)
        far.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        far.close()
        with pytest.raises(ConnectionResetError):
            calls.read_into(near.fileno(), bytearray(1))
        with pytest.raises(BrokenPipeError):
            calls.write(near.fileno(), b"x")


@pytest.mark.parametrize("descriptor", [-1, NO_DESCRIPTOR])
def test_what_is_no_descriptor_is_an_error(calls, descriptor):
    for call in (
        lambda: calls.read(descriptor, 1),
        lambda: calls.read_into(descriptor, bytearray(1)),
        lambda: calls.write(descriptor, b"x"),
    ):
        with pytest.raises(OSError, match="descriptor"):
            call()


@pytest.mark.parametrize("arguments", [(), (0,), ("0", 1), (0, "1"), (0, 1, 2)])
def test_arguments_of_another_kind_are_an_error_and_nothing_else(calls, arguments):
    for call in (calls.read, calls.read_into, calls.write):
        with pytest.raises(TypeError):
            call(*arguments)


def test_nothing_can_be_read_into_what_does_not_change(calls, pair):
    near, _ = pair
    with pytest.raises((TypeError, BufferError)):
        calls.read_into(near.fileno(), b"fixed")


def test_a_wait_finds_who_is_ready_and_why(calls, epoll, pair):
    near, far = pair
    epoll.register(near, select.EPOLLIN)
    epoll.register(far, select.EPOLLIN | select.EPOLLOUT)
    wait, known = calls.wait_of(epoll), {near.fileno(): "near", far.fileno(): "far"}
    assert wait(0.0, known) == ("far", select.EPOLLOUT)
    far.send(b"x")
    found = wait(PATIENCE, known)
    assert dict(zip(found[::2], found[1::2], strict=True)) == {"near": select.EPOLLIN, "far": select.EPOLLOUT}


def test_a_wait_has_nothing_for_a_descriptor_that_is_not_known(calls, epoll, pair):
    near, _ = pair
    epoll.register(near, select.EPOLLOUT)
    assert calls.wait_of(epoll)(0.0, {}) == (None, select.EPOLLOUT)


def test_a_wait_finds_the_end_of_a_connection(calls, epoll, pair):
    near, far = pair
    epoll.register(near, 0)
    far.close()
    assert calls.wait_of(epoll)(PATIENCE, {near.fileno(): near}) == (near, select.EPOLLHUP)


@pytest.mark.parametrize("seconds", [-1.0, 0.0])
def test_who_shall_not_wait_does_not(calls, epoll, seconds):
    assert calls.wait_of(epoll)(seconds, {}) == ()


@pytest.mark.parametrize("seconds", [0.0004, 0.0012, 0.0122, EXACT_PART - 0.0008])
def test_a_wait_is_as_long_as_it_shall_be_and_no_shorter(calls, epoll, seconds):
    wait = calls.wait_of(epoll)
    waited = []
    for _ in range(100):
        began = time.monotonic()
        assert wait(seconds, {}) == ()
        waited.append(time.monotonic() - began)
    assert min(waited) >= seconds - 0.000_002  # `select` counts in microseconds
    assert min(waited) < seconds + 0.0005


def test_a_long_wait_ends_before_its_exact_part(calls, epoll):
    """The kernel may end it late by a thousandth of it, and the rest is too short for that to matter."""
    wait = calls.wait_of(epoll)
    began = time.monotonic()
    assert wait(4 * EXACT_PART, {}) == ()
    assert 3 * EXACT_PART <= time.monotonic() - began < 4 * EXACT_PART


def test_a_wait_that_would_last_for_days_ends_when_somebody_is_ready(calls, epoll, pair):
    near, far = pair
    epoll.register(near, select.EPOLLIN)
    sender = threading.Timer(0.05, far.send, (b"x",))
    sender.start()
    assert calls.wait_of(epoll)(86400.0, {near.fileno(): near}) == (near, select.EPOLLIN)
    sender.join()


def test_descriptors_beyond_those_of_select_are_waited_for(calls):
    """A process with many clients; also the epoll itself may have such a number."""
    low, high = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = SELECTABLE + 200
    if high < wanted:
        pytest.skip(f"needs {wanted} descriptors")
    with ExitStack() as stack:
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(low, wanted), high))
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (low, high))
        pairs = [[stack.enter_context(end) for end in socket.socketpair()] for _ in range(SELECTABLE // 2)]
        epoll = stack.enter_context(closing(select.epoll()))
        assert epoll.fileno() >= SELECTABLE
        for near, _ in pairs:
            epoll.register(near, select.EPOLLIN | select.EPOLLET)
        wait = calls.wait_of(epoll)
        began = time.monotonic()
        assert wait(0.002, {}) == ()
        assert time.monotonic() - began >= 0.002
        for _, far in pairs:
            far.send(b"x")
        found = []
        known = {near.fileno(): near for near, _ in pairs}
        while ready := wait(0.0, known):
            assert len(ready) <= 2 * MOST_FOUND
            found += ready[::2]
        assert {*found} == {near for near, _ in pairs}
        assert len(found) == len(pairs)


@pytest.fixture
def alarm():
    """Sends a signal soon; `called` is what its handler notes, and `raised` what it raises."""
    state = {"called": 0, "raised": None}

    def handle(*_):
        state["called"] += 1
        if state["raised"]:
            raise state["raised"]

    before = signal.signal(signal.SIGALRM, handle)
    signal.setitimer(signal.ITIMER_REAL, 0.02)
    yield state
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("seconds", [EXACT_PART, 0.3])
def test_a_signal_is_handled_in_a_wait(calls, epoll, alarm, seconds):
    until = time.monotonic() + seconds
    wait = calls.wait_of(epoll)
    while (left := until - time.monotonic()) > 0.0:
        assert wait(left, {}) == ()
        if alarm["called"]:
            break
    assert alarm["called"] == 1


def test_what_the_handler_of_a_signal_raises_ends_a_wait(calls, epoll, alarm):
    """Also if compiled code waits again and again, where no handler is called by itself."""
    alarm["raised"] = KeyboardInterrupt
    results = []
    with pytest.raises(KeyboardInterrupt):
        results.extend(map(calls.wait_of(epoll), repeat(0.05, 200), repeat({})))
    assert len(results) < 200


def test_others_have_their_turn_while_it_waits(calls, epoll, pair):
    near, far = pair
    epoll.register(near, select.EPOLLIN)

    def compute_and_send():
        far.send(b"%d" % sum(range(100_000)))

    computing = threading.Thread(target=compute_and_send)
    computing.start()
    assert calls.wait_of(epoll)(PATIENCE, {near.fileno(): near}) == (near, select.EPOLLIN)
    computing.join()


def test_nothing_of_it_stays_in_memory(calls, epoll, pair):
    near, far = pair
    epoll.register(near, select.EPOLLIN)
    descriptor, room = near.fileno(), bytearray(300)

    def once():
        wait = calls.wait_of(epoll)
        far.send(bytes(300))
        assert wait(0.0, {descriptor: near})[0] is near
        calls.read_into(descriptor, room)
        calls.read(descriptor, 300)
        far.send(bytes(300))
        calls.read(descriptor, 300)
        calls.write(descriptor, room)
        far.recv(300)
        for call in (calls.read, calls.read_into, calls.write):
            with pytest.raises(TypeError):
                call(descriptor, None)
        with pytest.raises(OSError, match="descriptor"):
            calls.read(NO_DESCRIPTOR, 1)
        with pytest.raises(TypeError):
            wait(None, {})

    def held():
        gc.collect()
        return tracemalloc.get_traced_memory()[0], *(sys.getrefcount(each) for each in (near, room, None))

    rounds = 1000
    tracemalloc.start()
    try:
        seen = [held()]
        for _ in range(4):
            for _ in range(rounds):
                once()
            seen.append(held())
    finally:
        tracemalloc.stop()
    more = [[after - before for before, after in pairwise(each)] for each in zip(*seen, strict=True)]
    assert [min(each) < rounds for each in more] == [True] * 4, more  # others keep something too, now and then
