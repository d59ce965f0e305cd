"""The rows of `growth.py` that are parts of the gateway: it runs this under valgrind, with a counter to begin and end.

`make` of a row builds one of a size, and returns the step. For figures that do not depend on the machine no step waits,
and each has as much to do as the one before.
"""

import asyncio
import ctypes
import gc
import sys
from collections.abc import Callable
from functools import cache, partial
from itertools import cycle

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.events import Emit, Event
from gateway.listeners.sessions.mbap import MbapSession
from gateway.listeners.sessions.session import Connection
from gateway.modbus import mbap, rtu
from gateway.observe.backlog import Backlog, entry_of
from gateway.observe.fan_out import FanOut
from gateway.request import Caller
from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running
from kit.many_ranges import ManyRanges

#: Steps that do not count, until events have been told so often that they are only counted; and those that do.
BEFORE, STEPS = 1000, 400
UNIT = 17
READ = bytes((3, 0, 16, 0, 10))
WRITE = bytes((6, 0, 16, 0, 10))
#: The most devices of a map.
DEVICES = 200
CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:1502"
in_flight = 20

[[line]]
name = "line"
port = "/dev/ttyS0"
format = "8N1"
gap = "0"
coalesce = false
"""
#: How many requests each client has in a full queue.
EACH = 16

Step = Callable[[], object]


@cache
def begin() -> float:
    """When the first client came."""
    return asyncio.get_running_loop().time()


class Client(Connection):
    """A client of a host of its own, from the bytes of its requests to those of its answers."""

    def __init__(self, gateway: Gateway, number: int = 0) -> None:
        host = f"127.0.{number // 250}.{number % 250 + 1}"
        listener = gateway.listeners[0]
        self._number = 0
        self.answers = 0
        caller = Caller(f"{host}:1", host, host)
        settings = listener.settings
        self.session = MbapSession(caller, router=listener.router, connection=self, settings=settings, now=self.time())

    def time(self) -> float:
        """For all clients it stands still: what a line tells every few seconds is no part of a step."""
        return begin()

    def ask(self, pdu: bytes = READ) -> None:
        """One request more, even if the last one was refused."""
        self.session.release()
        self._number = self._number + 1 & 0xFFFF
        adu = mbap.encode(self._number, UNIT, pdu)
        self.session.room()[: len(adu)] = adu
        self.session.received(len(adu), self.time())

    def leave(self) -> None:
        """Close the connection."""
        self.session.closed()

    def send(self, data: bytes) -> None:
        self.answers += 1

    def receive(self, room: memoryview) -> int:
        return 0

    def release_after(self, seconds: float) -> None:
        """It asks when it likes."""

    def pause(self) -> None:
        """It does not ask while it is not read."""

    resume = pause

    def wake(self, when: float | None) -> None:
        """Nothing has come that was not read."""


class Line:
    """A line, and its clients. Its device answers when it is told to."""

    is_virtual = True
    has_arrived = None
    latency = 0.0

    def __init__(self, queue: int, clients: int) -> None:
        self.gateway = running(f'{CONFIG}queue = {queue}\nmax_wait = "1 h"\n', told())
        self.driver = self.gateway.lines[0].driver
        self.driver.port_up(self)
        self.clients = [Client(self.gateway, number) for number in range(clients)]

    def write(self, data: bytes) -> None:
        """Its devices hear it."""

    def read_now(self) -> None:
        """Nothing stands unread on the line."""

    def pause(self) -> bool:
        """It is looked at all the time."""
        return False


class FullLine(Line):
    """One whose device does not answer, and for which so many requests wait as may."""

    def __init__(self, size: int) -> None:
        super().__init__(size, size // EACH + 1)
        first, *others = self.clients
        for client in [first, *others * EACH]:
            client.ask()
        self._greedy = cycle(others)

    def is_refused(self) -> None:
        """One of those with most asks for more."""
        client = next(self._greedy)
        before = client.answers
        client.ask()
        if client.answers == before:
            raise AssertionError("not refused")

    def makes_another_lose(self) -> None:
        """Somebody asks, for whom another one loses a request; and leaves, so that that one can ask again."""
        newcomer = Client(self.gateway, 60_000)
        newcomer.ask()
        newcomer.leave()
        next(self._greedy).ask()


class BusyLine(Line):
    """One for which a request of each client waits, but that of the one whose turn it is."""

    def __init__(self, clients: int) -> None:
        super().__init__(clients, clients)
        for client in self.clients:
            client.ask()
        self._turns = cycle(self.clients)
        self._answer = rtu.encode(UNIT, bytes((3, 20)) + bytes(20))

    def answers(self) -> None:
        """A client gets its answer, and asks again."""
        client = next(self._turns)
        before = client.answers
        self.driver.received(self._answer)
        if client.answers == before:
            raise AssertionError("not answered")
        client.ask()


def unknown_read(size: int) -> Step:
    """A read of one range of a mirror, as the first one."""
    mirror = ManyRanges(size)

    def step() -> None:
        mirror.forget_reads()
        mirror.read(3)

    return step


def row_written(size: int) -> Step:
    """What tells of the freshness of its device is read too."""
    unit = ManyRanges(size, is_mapped=True)

    def step() -> None:
        unit.write(3)
        unit.ask(1, 0, 1)
        unit.ask(4, 0, 1)

    return step


def written_image(registers: int) -> Step:
    """A client that writes to an image of so many registers."""
    config = f'[[listen]]\nbind = "tcp://127.0.0.1:1502"\n[[image]]\nunit = {UNIT}\nholding = "0-{registers - 1}"\n'
    client = Client(running(config, told()))
    return lambda: client.ask(WRITE)


def told() -> Emit:
    """Where events go up to the thread that writes them, which is behind."""
    backlog = Backlog()

    def log(event: Event) -> None:
        backlog.add(entry_of(event))

    return FanOut(log).emit


def running(config: str, emit: Emit) -> Gateway:
    """A gateway with this config."""
    plan = resolve(parse(config, port_trouble=lambda _: None, real_path=lambda port: port).config)
    return Running(plan, lambda _: None, emit).gateway


#: By name, what makes the step at a size.
ROWS: dict[str, Callable[[int], Step]] = {
    "refusal": lambda size: FullLine(size).is_refused,
    "loss": lambda size: FullLine(size).makes_another_lose,
    "mirror": lambda size: ManyRanges(size).read,
    "map": lambda size: ManyRanges(size, devices=min(size, DEVICES), is_mapped=True).read,
    "write": written_image,
    "clients": lambda size: BusyLine(size).answers,
    "ranges": unknown_read,
    "written": lambda size: partial(ManyRanges(size).write, 3),
    "poll": lambda size: ManyRanges(size).poll_one,
    "row": row_written,
}


async def main(counter: str, row: str, *sizes: str) -> None:
    """Take the steps of a row at each size; print how many of them count."""
    library = ctypes.CDLL(counter)
    gc.disable()  # which step a collection falls into is luck
    for size in sizes:
        step = ROWS[row](int(size))
        for _ in range(BEFORE):
            step()
        library.begin_counting()
        for _ in range(STEPS):
            step()
        library.end_counting()
    print(STEPS)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
