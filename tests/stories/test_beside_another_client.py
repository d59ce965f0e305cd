"""A line that has another client, which does not listen before it asks: both get their answers, a dead unit or not."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

import pytest

from gateway.modbus.rtu import with_crc
from kit.asker import Asker
from kit.line_bench import LATENCY, TIMING, Bench

READ = "03 00 10 00 01"
THINKS = 0.02
SECONDS = 60
#: Units that our clients read, one each, and those that the other client reads in turn.
OURS = (1, 2)
THEIRS = (4, 5, 6)


@dataclass
class Frame:
    sender: str
    data: bytes
    ends_at: float
    has_collided: bool = False


class Bus:
    """Two clients and their devices: what two send at once reaches nobody."""

    def __init__(self, *, timeout: float, pause: float, dead: tuple[int, ...] = ()) -> None:
        self.answered = {"ours": 0, "theirs": 0}
        self.collided = 0
        self._timeout, self._pause, self._dead = timeout, pause, dead
        self._dice = random.Random(1)
        self._bench = Bench(virtual=False)
        self._bench.line.port_up(lambda data: self._send("we", data), LATENCY, self.now, virtual=False)
        self._order = count()
        self._agenda: list[tuple[float, int, Callable[[], None]]] = []
        self._on_the_wire: list[Frame] = []
        self._their_turn = count()
        self._turn = 0
        self._they_await = 0

    @property
    def now(self) -> float:
        return self._bench.now

    def run(self) -> "Bus":
        clients = [Asker(f"10.0.0.{unit}:1") for unit in OURS]
        end = self.now + SECONDS
        for client, unit in zip(clients, OURS, strict=True):
            self._bench.ask(READ, unit, client)
        if self._timeout:
            self._they_ask()
        while self.now < end:
            self._go_on()
            for client, unit in zip(clients, OURS, strict=True):
                if client.answers:
                    self.answered["ours"] += client.answers.pop().startswith("03")
                    self._bench.ask(READ, unit, client)
        return self

    def _go_on(self) -> None:
        deadline, line = self._bench.line.deadline(), self._bench.line
        if deadline is not None and (not self._agenda or deadline < self._agenda[0][0]):
            self._bench.now = max(self.now, deadline)
            line.tick(self.now)
        else:
            self._bench.now, _, step = heappop(self._agenda)
            step()

    def _later(self, seconds: float, step: Callable[[], None]) -> None:
        heappush(self._agenda, (self.now + seconds, next(self._order), step))

    def _send(self, sender: str, data: bytes) -> None:
        frame = Frame(sender, data, self.now + len(data) * TIMING.character)
        self._on_the_wire = [each for each in self._on_the_wire if each.ends_at > self.now]
        frame.has_collided = bool(self._on_the_wire)
        for other in self._on_the_wire:
            other.has_collided = True
        self._on_the_wire.append(frame)
        self._later(len(data) * TIMING.character, lambda: self._arrive(frame))

    def _arrive(self, frame: Frame) -> None:
        self.collided += frame.has_collided
        data = self._dice.randbytes(len(frame.data)) if frame.has_collided else frame.data
        if frame.sender != "we":
            self._bench.line.received(data, self.now)
        if frame.has_collided:
            return
        unit = data[0]
        if frame.sender != "a device" and unit not in self._dead:
            response = with_crc(bytes((unit, 3, 2)) + self._dice.randbytes(2))
            self._later(THINKS, lambda: self._send("a device", response))
        if frame.sender == "a device" and unit == self._they_await:
            self.answered["theirs"] += 1
            self._they_await = 0
            turn = self._turn = next(self._their_turn)
            self._later(self._pause, lambda: self._they_ask(turn))

    def _they_ask(self, turn: int = 0) -> None:
        if turn and turn != self._turn:
            return
        turn = self._turn = next(self._their_turn) or next(self._their_turn)
        self._they_await = THEIRS[turn % len(THEIRS)]
        self._send("they", with_crc(bytes((self._they_await, 3, 0, turn % 256, 0, 1))))
        self._later(self._timeout, lambda: self._they_ask(turn))


@pytest.mark.parametrize(
    ("pause", "timeout", "dead", "ours", "theirs"),
    [
        pytest.param(0.01, 1.0, (), 0.75, 20.0, id="they ask all the time"),
        pytest.param(0.2, 1.0, (), 0.9, 4.0, id="they pause"),
        pytest.param(0.01, 1.0, (6,), 0.86, 0.8, id="one unit in three is dead, and they ask all the time"),
        pytest.param(0.2, 0.3, (6,), 0.9, 1.6, id="one unit in three is dead, and they pause"),
    ],
)
def test_both_clients_get_their_answers(
    pause: float, timeout: float, dead: tuple[int, ...], ours: float, theirs: float
) -> None:
    """`ours` is the share of what we get alone, `theirs` is so many a second."""
    alone = Bus(timeout=0.0, pause=0.0).run().answered["ours"]
    bus = Bus(timeout=timeout, pause=pause, dead=dead).run()
    assert bus.answered["ours"] > ours * alone
    assert bus.answered["theirs"] > theirs * SECONDS
    assert bus.collided < 1.2 * SECONDS
