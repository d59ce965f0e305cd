"""The event loop of a running gateway, in real time: never early, and late by much less than a millisecond."""

import asyncio
import selectors
import socket
import threading
import time
from contextlib import closing

import pytest

from gateway.ports import exact_loop as exact_loop_module
from gateway.ports.exact_loop import EXACT_PART, ExactSelector, exact_loop, run_exactly

#: asyncio runs what is due within this time.
CLOCK_RESOLUTION = time.get_clock_info("monotonic").resolution


async def lateness(delay: float) -> float:
    """How many seconds after its time a timer was called."""
    loop = asyncio.get_running_loop()
    due = loop.time() + delay
    called: asyncio.Future[float] = loop.create_future()
    loop.call_at(due, lambda: called.set_result(loop.time()))
    return await called - due


@pytest.mark.parametrize("delay", [0.00105, 0.0121, EXACT_PART + 0.00105])
async def test_timers_are_never_early(delay: float) -> None:
    assert min([await lateness(delay) for _ in range(20)]) >= -CLOCK_RESOLUTION


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


def test_a_descriptor_ends_an_exact_wait() -> None:
    near, far = socket.socketpair()
    with near, far, closing(ExactSelector()) as selector:
        selector.register(near, selectors.EVENT_READ, ("read", None))
        far.send(b"x")
        assert selector.select(EXACT_PART) == ["read"]


def test_it_returns_what_waits_for_a_descriptor_at_the_moment() -> None:
    near, far = socket.socketpair()
    with near, far, closing(ExactSelector()) as selector:
        far.send(b"x")
        selector.register(near, selectors.EVENT_READ | selectors.EVENT_WRITE, ("read", "write"))
        assert selector.select(0) == ["read", "write"]
        selector.modify(near, selectors.EVENT_READ, ("another", None))
        assert selector.select(0) == ["another"]
        selector.unregister(near)
        assert selector.select(0) == []


def test_the_end_of_a_connection_is_for_who_reads_and_for_who_writes() -> None:
    near, far = socket.socketpair()
    with near, closing(ExactSelector()) as selector:
        selector.register(near, selectors.EVENT_WRITE, (None, "write"))
        far.close()
        assert selector.select(0) == ["write"]
        selector.modify(near, selectors.EVENT_READ, ("read", None))
        assert selector.select(0) == ["read"]


def test_a_masked_descriptor_is_left_alone_unless_what_is_behind_it_is_lost() -> None:
    near, far = socket.socketpair()
    with near, closing(ExactSelector()) as selector:
        selector.register(near, selectors.EVENT_READ, ("read", None))
        selector.mask(near.fileno(), is_masked=True)
        far.send(b"x")
        assert selector.select(0) == []
        selector.mask(near.fileno(), is_masked=False)
        assert selector.select(0) == ["read"]
        selector.mask(near.fileno(), is_masked=True)
        far.close()
        assert selector.select(0) == ["read"]


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
        (asyncio.SelectorEventLoop, "_process_events"),
        (asyncio.Handle, "_run"),
        (asyncio.Handle, "_cancelled"),
    ],
)
def test_a_private_name_is_there(owner: type, name: str) -> None:
    """A version of Python without one gets asyncio's own loop."""
    with closing(selectors.EpollSelector()) as selector:
        assert hasattr(selector if owner is selectors.EpollSelector else owner, name)


def test_without_a_private_name_the_loop_is_that_of_asyncio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_loop_module, "_NAMES", ((asyncio.Handle, "_no_such_name"),))
    with closing(exact_loop()) as loop:
        assert type(loop) is asyncio.SelectorEventLoop
        loop.run_until_complete(asyncio.sleep(0))


@pytest.mark.parametrize(("parts", "waited"), [(0.3, 0.3), (1.0, 1.0), (1.5, 0.5)])
def test_a_short_wait_is_whole_and_a_long_one_ends_before_its_exact_part(parts: float, waited: float) -> None:
    with closing(ExactSelector()) as selector:
        started = time.monotonic()
        assert selector.select(parts * EXACT_PART) == []
        assert time.monotonic() - started >= waited * EXACT_PART - CLOCK_RESOLUTION


async def test_waiting_takes_no_processor_time() -> None:
    used = time.process_time()
    for _ in range(10):
        await lateness(1.5 * EXACT_PART)
    assert time.process_time() - used < 0.3  # who asks over and over uses most of 0.6 s


@pytest.mark.parametrize("timeout", [0, -1])
def test_it_does_not_wait_when_it_shall_not(timeout: float) -> None:
    with closing(ExactSelector()) as selector:
        assert selector.select(timeout) == []


def test_with_too_many_descriptors_open_it_waits_as_asyncio_does() -> None:
    with closing(BeyondSelect()) as selector:
        started = time.monotonic()
        assert selector.select(0.0005) == []
        assert time.monotonic() - started >= 0.0005


class BeyondSelect(ExactSelector):
    """Its descriptor has a number that `select` does not know."""

    def fileno(self) -> int:
        return 1024


def test_it_runs_a_program_and_hands_over_its_result() -> None:
    async def program() -> bool:
        return isinstance(asyncio.get_running_loop()._selector, ExactSelector)

    assert run_exactly(program())


def test_a_kernel_that_keeps_its_slack_is_no_obstacle(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(exact_loop_module, "_SLACK", tmp_path / "absent" / "slack")
    exact_loop().close()


def test_the_kernel_takes_the_slack() -> None:
    exact_loop().close()
    assert exact_loop_module._SLACK.read_text() == "1\n"
