"""The event loop of a running gateway, in real time: never early, and late by much less than a millisecond."""

import asyncio
import selectors
import socket
import threading
import time
from contextlib import closing
from functools import partial

import pytest

from gateway.clock import exact_loop as exact_loop_module
from gateway.clock.exact_loop import ExactLoop, ExactSelector, new_exact_loop, run_exactly
from gateway.clock.system_calls import EXACT_PART

pytest_plugins = ["kit.system_calls"]

#: asyncio runs what is due within this time.
CLOCK_RESOLUTION = time.get_clock_info("monotonic").resolution


async def lateness(delay: float) -> float:
    """How many seconds after its time a timer was called."""
    loop = asyncio.get_running_loop()
    due = loop.time() + delay
    called: asyncio.Future[float] = loop.create_future()
    loop.call_at(due, lambda: called.set_result(loop.time()))
    return await called - due


@pytest.mark.usefixtures("waits_with")
@pytest.mark.parametrize("delay", [0.00105, 0.0121, EXACT_PART + 0.00105])
def test_timers_are_never_early(delay: float) -> None:
    async def least() -> float:
        return min([await lateness(delay) for _ in range(20)])

    assert run_exactly(least()) >= -CLOCK_RESOLUTION


@pytest.mark.usefixtures("waits_with")
@pytest.mark.parametrize("wait", [0.0012, 0.0122, EXACT_PART - 0.0008])
def test_a_wait_is_longer_by_much_less_than_a_millisecond(wait: float) -> None:
    """A busy machine adds its own, now and then; `epoll_wait` is 0.8 ms late each time."""
    with closing(ExactSelector()) as selector:
        assert any(waited(selector, wait) < wait + 0.0005 for _ in range(500))


def waited(selector: ExactSelector, timeout: float) -> float:
    """How many seconds it waits for nothing."""
    started = time.monotonic()
    assert selector.select(timeout) == []
    return time.monotonic() - started


def test_a_thread_that_computes_hands_over_in_less_than_a_millisecond() -> None:
    """Where the interpreter keeps its 5 ms, each timer is as late; a busy machine makes some of them so."""
    is_over = threading.Event()

    def compute() -> None:
        while not is_over.is_set():
            sum(range(100))

    async def least() -> float:
        thread = threading.Thread(target=compute)
        thread.start()
        try:
            return min([await lateness(0.001) for _ in range(200)])
        finally:
            is_over.set()
            thread.join()

    assert run_exactly(least()) < 0.003


@pytest.fixture
def pair():
    near, far = socket.socketpair()
    with near, far:
        yield near, far


@pytest.fixture
def selector(waits_with):
    with closing(ExactSelector()) as selector:
        yield selector


@pytest.fixture
def called():
    return []


@pytest.fixture
def handle():
    """Makes handles of callbacks, as a loop does."""
    with closing(asyncio.SelectorEventLoop()) as loop:
        yield lambda callback, *arguments: asyncio.Handle(callback, arguments, loop)


@pytest.fixture
def note(called, handle):
    """Makes handles whose callback notes their name."""
    return partial(handle, called.append)


def test_a_descriptor_ends_an_exact_wait(selector, pair, handle):
    near, far = pair
    ready = selector.waiter.ready
    selector.register(near, selectors.EVENT_READ, (handle(ready.append, "read"), None))
    far.send(b"x")
    assert selector.select(EXACT_PART) == []
    assert list(ready) == ["read"]


def test_it_calls_what_waits_for_a_descriptor_at_the_moment(selector, pair, called, note):
    near, far = pair
    far.send(b"x")
    selector.register(near, selectors.EVENT_READ | selectors.EVENT_WRITE, (note("read"), note("write")))
    selector.select(0)
    assert called == ["read", "write"]
    selector.modify(near, selectors.EVENT_READ, (note("another"), None))
    selector.select(0)
    assert called[2:] == ["another"]
    selector.unregister(near)
    selector.select(0)
    assert called[3:] == []


def test_the_end_of_a_connection_is_for_who_reads_and_for_who_writes(selector, pair, called, note):
    near, far = pair
    selector.register(near, selectors.EVENT_WRITE, (None, note("write")))
    far.close()
    selector.select(0)
    assert called == ["write"]
    selector.modify(near, selectors.EVENT_READ, (note("read"), None))
    selector.select(0)
    assert called[1:] == ["read"]


def test_a_masked_descriptor_is_left_alone_unless_what_is_behind_it_is_lost(selector, pair, called, note):
    near, far = pair
    selector.register(near, selectors.EVENT_READ, (note("read"), None))
    selector.waiter.mask(near.fileno())
    far.send(b"x")
    selector.select(0)
    assert called == []
    selector.waiter.unmask(near.fileno())
    selector.select(0)
    assert called == ["read"]
    selector.waiter.mask(near.fileno())
    far.close()
    selector.select(0)
    assert called == ["read", "read"]


def test_who_writes_to_a_masked_descriptor_is_called_all_the_same(selector, pair, called, note):
    near, far = pair
    selector.register(near, selectors.EVENT_READ | selectors.EVENT_WRITE, (note("read"), note("write")))
    far.send(b"x")
    selector.waiter.mask(near.fileno())
    selector.select(0)
    assert called == ["write"]
    selector.waiter.unmask(near.fileno())
    selector.select(0)
    assert called[1:] == ["read", "write"]


def test_a_descriptor_that_is_masked_and_unmasked_at_once_is_read_from(selector, pair, called, note):
    near, far = pair
    selector.register(near, selectors.EVENT_READ, (note("read"), None))
    far.send(b"x")
    for _ in range(2):
        selector.waiter.mask(near.fileno())
        selector.waiter.unmask(near.fileno())
    selector.select(0)
    assert called == ["read"]


def test_another_reader_of_a_descriptor_that_was_masked_reads_once_it_is_not(selector, pair, called, note):
    near, far = pair
    selector.register(near, selectors.EVENT_READ, (note("read"), None))
    selector.waiter.mask(near.fileno())
    far.send(b"x")
    selector.select(0)
    selector.waiter.unmask(near.fileno())
    selector.modify(near, selectors.EVENT_READ, (note("another"), None))
    selector.select(0)
    assert called == ["another"]


def test_what_was_masked_and_is_closed_leaves_nothing_to_who_has_its_number(selector, pair, called, note):
    near, far = pair
    selector.register(near, selectors.EVENT_READ, (note("read"), None))
    selector.waiter.mask(near.fileno())
    selector.unregister(near)
    selector.select(0)
    far.send(b"x")
    selector.register(near, selectors.EVENT_READ, (note("another"), None))
    selector.select(0)
    assert called == ["another"]


def test_a_masked_descriptor_stays_so_when_somebody_writes_to_it_and_has_done(selector, pair, called, note):
    near, far = pair
    reads = note("read")
    selector.register(near, selectors.EVENT_READ, (reads, None))
    selector.waiter.mask(near.fileno())
    far.send(b"x")
    selector.modify(near, selectors.EVENT_READ | selectors.EVENT_WRITE, (reads, note("write")))
    selector.select(0)
    selector.modify(near, selectors.EVENT_READ, (reads, None))
    selector.select(0)
    assert called == ["write"]
    selector.waiter.unmask(near.fileno())
    selector.select(0)
    assert called == ["write", "read"]


@pytest.mark.parametrize("keeps_its_writer", [True, False])
def test_who_reads_a_descriptor_anew_finds_it_unmasked(selector, pair, called, note, keeps_its_writer):
    near, far = pair
    selector.register(near, selectors.EVENT_READ, (note("read"), None))
    selector.waiter.mask(near.fileno())
    far.send(b"x")
    if keeps_its_writer:
        selector.modify(near, selectors.EVENT_WRITE, (None, note("write")))
        selector.modify(near, selectors.EVENT_READ, (note("another"), None))
    else:
        selector.unregister(near)
        selector.register(near, selectors.EVENT_READ, (note("another"), None))
    selector.select(0)
    assert called == ["another"]


def test_it_goes_on_waiting_while_the_loop_has_nothing_to_call(selector, pair, handle):
    near, far = pair
    reads = []

    def read():
        reads.append(near.recv(1))
        if len(reads) < 3:
            far.send(b"x")
        else:
            selector.waiter.end_by(0.0)

    selector.register(near, selectors.EVENT_READ, (handle(read), None))
    far.send(b"x")
    selector.select(30)
    assert len(reads) == 3


async def test_a_timer_that_a_descriptors_callback_has_set_is_in_time(pair):
    """The loop has begun to wait for something that is much later."""
    near, far = pair
    loop = asyncio.get_running_loop()
    called = loop.create_future()

    def read():
        near.recv(1)
        loop.call_later(0.001, called.set_result, None)

    loop.add_reader(near, read)
    loop.call_later(0.001, far.send, b"x")
    async with asyncio.timeout(30):
        await called
    loop.remove_reader(near)


def test_a_descriptors_callback_can_stop_the_loop(pair):
    near, far = pair
    with closing(new_exact_loop()) as loop:
        loop.add_reader(near, loop.stop)
        far.send(b"x")
        loop.run_forever()
        loop.remove_reader(near)


async def test_a_callback_of_another_thread_ends_the_wait():
    loop = asyncio.get_running_loop()
    called = loop.create_future()
    thread = threading.Timer(0.001, loop.call_soon_threadsafe, (called.set_result, None))
    thread.start()
    async with asyncio.timeout(30):
        await called
    thread.join()


async def test_it_calls_back_at_the_time_never_before_and_in_order():
    loop = asyncio.get_running_loop()
    now = loop.time()
    called, over = [], loop.create_future()
    for number, delay in enumerate((0.004, 0.001, 0.001)):
        loop.wake_at(now + delay, lambda number=number, at=now + delay: called.append((number, loop.time() >= at)))
    loop.wake_at(now + 0.005, lambda: over.set_result(None))
    async with asyncio.timeout(30):
        await over
    assert called == [(1, True), (2, True), (0, True)]


async def test_what_is_due_in_a_month_waits_as_everything_else():
    """`epoll` takes 24 days at most."""
    loop = asyncio.get_running_loop()
    woken = loop.create_future()
    loop.wake_at(loop.time() + 30 * 86400, lambda: None)
    thread = threading.Timer(0.05, loop.call_soon_threadsafe, (woken.set_result, None))
    thread.start()
    await woken
    thread.join()


async def test_a_callback_that_is_always_due_again_leaves_others_their_turn():
    loop = asyncio.get_running_loop()
    over = loop.create_future()
    called = 0

    def again():
        nonlocal called
        called += 1
        if called < 100_000 and not over.done():
            loop.wake_at(0.0, again)

    again()
    loop.call_later(0.001, over.set_result, None)
    await over
    assert called < 100_000


@pytest.mark.parametrize("kind", ["descriptor", "time"])
async def test_a_cancellation_in_a_callback_is_reported_and_does_not_end_the_loop(pair, kind) -> None:
    near, far = pair
    loop = asyncio.get_running_loop()
    reported = []
    over = loop.create_future()

    def report(_, context):
        reported.append(type(context["exception"]))
        over.set_result(None)

    def take() -> None:
        loop.remove_reader(near)
        raise asyncio.CancelledError

    loop.set_exception_handler(report)
    if kind == "descriptor":
        loop.add_reader(near, take)
        far.send(b"x")
    else:
        loop.wake_at(loop.time(), take)
    async with asyncio.timeout(30):
        await over
    assert reported == [asyncio.CancelledError]


@pytest.mark.parametrize("end", [SystemExit, KeyboardInterrupt])
def test_an_end_of_the_program_in_a_callback_ends_the_loop(end) -> None:
    def take() -> None:
        raise end

    with closing(new_exact_loop()) as loop:
        loop.wake_at(loop.time(), take)
        loop.call_later(30, loop.stop)
        with pytest.raises(end):
            loop.run_forever()


async def test_an_error_in_a_callback_at_its_time_is_reported_and_the_next_one_is_called():
    loop = asyncio.get_running_loop()
    reported, over = [], loop.create_future()
    loop.set_exception_handler(lambda _, context: reported.append(type(context["exception"])))
    loop.wake_at(loop.time(), lambda: 1 / 0)
    loop.wake_at(loop.time(), lambda: over.set_result(None))
    async with asyncio.timeout(30):
        await over
    assert reported == [ZeroDivisionError]


@pytest.mark.parametrize("wakes", ["descriptor", "time"])
async def test_what_the_loop_was_asked_to_call_comes_before_what_has_become_ready_since(pair, wakes) -> None:
    """As in asyncio: a connection that goes on processes what it has before it receives more."""
    near, far = pair
    loop = asyncio.get_running_loop()
    called, over = [], loop.create_future()

    def receive() -> None:
        loop.remove_reader(near)
        called.append("ready")
        over.set_result(None)

    def go_on() -> None:
        loop.call_soon(called.append, "asked for")
        if wakes == "descriptor":
            loop.add_reader(near, receive)
        else:
            loop.wake_at(loop.time(), receive)

    far.send(b"x")
    loop.call_soon(go_on)
    async with asyncio.timeout(30):
        await over
    assert called == ["asked for", "ready"]


async def test_what_is_ready_is_called_though_the_loop_is_never_idle(pair) -> None:
    near, far = pair
    loop = asyncio.get_running_loop()
    received, due = loop.create_future(), loop.create_future()

    def receive() -> None:
        loop.remove_reader(near)
        received.set_result(None)

    def never_idle() -> None:
        if not (received.done() and due.done()):
            loop.call_soon(never_idle)

    never_idle()
    loop.add_reader(near, receive)
    loop.wake_at(loop.time(), lambda: due.set_result(None))
    far.send(b"x")
    async with asyncio.timeout(30):
        await asyncio.gather(received, due)


async def test_a_callback_that_another_one_has_removed_is_not_called() -> None:
    loop = asyncio.get_running_loop()
    pairs = [socket.socketpair() for _ in range(2)]
    called = []

    def take(number: int) -> None:
        called.append(number)
        for near, _ in pairs:
            loop.remove_reader(near)

    for number, (near, far) in enumerate(pairs):
        far.send(b"x")
        loop.add_reader(near, take, number)
    await asyncio.sleep(0.01)
    assert len(called) == 1
    close_all(pairs)


@pytest.mark.parametrize(("first", "order"), [(True, ["ready", "due", "ready"]), (False, ["ready", "ready", "due"])])
async def test_what_is_due_while_something_is_ready_comes_next_if_it_is_to_be_first(first: bool, order: list) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, ExactLoop)
    called: list[str] = []

    def read(near: socket.socket) -> None:
        loop.remove_reader(near)
        called.append("ready")
        if len(called) == 1:
            loop.wake_at(loop.time(), partial(called.append, "due"), first=first)

    pairs = [socket.socketpair() for _ in range(2)]
    for near, far in pairs:
        far.send(b"x")
        loop.add_reader(near, read, near)
    await asyncio.sleep(0.01)
    assert called == order
    close_all(pairs)


async def test_an_error_in_a_callback_is_reported_and_the_others_are_called() -> None:
    loop = asyncio.get_running_loop()
    pairs = [socket.socketpair() for _ in range(2)]
    reported, called = [], []
    loop.set_exception_handler(lambda _, context: reported.append(context["exception"]))

    def take(near: socket.socket) -> None:
        called.append(near)
        loop.remove_reader(near)
        raise ZeroDivisionError

    for near, far in pairs:
        far.send(b"x")
        loop.add_reader(near, take, near)
    await asyncio.sleep(0.01)
    assert len(called) == 2
    assert [type(error) for error in reported] == [ZeroDivisionError, ZeroDivisionError]
    close_all(pairs)


def close_all(pairs: list[tuple[socket.socket, socket.socket]]) -> None:
    for pair in pairs:
        for each in pair:
            each.close()


async def test_its_clock_is_that_of_the_timers() -> None:
    loop = asyncio.get_running_loop()
    assert abs(loop.time() - time.monotonic()) < 1


@pytest.mark.parametrize(
    ("owner", "name"),
    [
        (selectors.EpollSelector, "_selector"),
        (asyncio.SelectorEventLoop, "_ready"),
        (asyncio.Handle, "_context"),
        (asyncio.Handle, "_callback"),
        (asyncio.Handle, "_args"),
        (asyncio.Handle, "_cancelled"),
    ],
)
def test_a_private_name_is_there(owner: type, name: str) -> None:
    """A version of Python without one gets asyncio's own loop."""
    with closing(selectors.EpollSelector()) as selector, closing(asyncio.SelectorEventLoop()) as loop:
        assert hasattr({selectors.EpollSelector: selector, asyncio.SelectorEventLoop: loop}.get(owner, owner), name)


def test_the_loops_own_callbacks_wait_in_what_is_looked_at() -> None:
    with closing(new_exact_loop()) as loop:
        assert isinstance(loop, ExactLoop)
        loop.call_soon(print)
        assert len(loop._selector.waiter.ready) == 1


def test_without_a_private_name_the_loop_is_that_of_asyncio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_loop_module, "_NAMES", ((asyncio.Handle, "_no_such_name"),))
    with closing(new_exact_loop()) as loop:
        assert type(loop) is asyncio.SelectorEventLoop
        loop.run_until_complete(asyncio.sleep(0))


def test_without_the_queue_of_callbacks_the_loop_is_that_of_asyncio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_loop_module, "ExactLoop", _NoQueue)
    with closing(new_exact_loop()) as loop:
        assert type(loop) is asyncio.SelectorEventLoop
        loop.run_until_complete(asyncio.sleep(0))


class _NoQueue:
    """The loop of a Python without one of the names."""

    def __init__(self, selector: ExactSelector) -> None:
        self._waiter = selector.waiter
        self._waiter.ready = self._ready


async def test_waiting_takes_no_processor_time() -> None:
    used = time.process_time()
    for _ in range(10):
        await lateness(1.5 * EXACT_PART)
    assert time.process_time() - used < 0.3  # who asks over and over uses most of 0.6 s


@pytest.mark.parametrize("timeout", [0, -1])
def test_it_does_not_wait_when_it_shall_not(selector, timeout: float) -> None:
    assert selector.select(timeout) == []


def test_it_runs_a_program_and_hands_over_its_result() -> None:
    async def program() -> bool:
        return isinstance(asyncio.get_running_loop()._selector, ExactSelector)

    assert run_exactly(program())


def test_a_kernel_that_keeps_its_slack_is_no_obstacle(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(exact_loop_module, "_SLACK", tmp_path / "absent" / "slack")
    new_exact_loop().close()


def test_the_kernel_takes_the_slack() -> None:
    new_exact_loop().close()
    assert exact_loop_module._SLACK.read_text() == "1\n"
