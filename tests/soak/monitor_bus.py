"""A bus with real clients and devices in virtual time, for `monitor.py`: everything takes its time on the wire.

What two send at once reaches nobody whole. Devices answer one request after the other; what comes while one is busy, it
keeps or does not hear. Each answer has a count in it, so that it is known which request it was given to.
"""

import random
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import inf
from typing import Final

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.timing.characters import LineTiming

#: The late window of each unit, in seconds; odd units keep what comes while they are busy.
WINDOWS: Final = {1: 0.5, 2: 0.5, 3: 1.0, 4: 1.0, 5: 2.0, 6: 5.0, 7: 0.5, 8: 1.0}
#: What clients ask of each unit, with how many items; some are of equal size, and some answers can be read both ways.
_READS: Final = ((3, 4), (3, 4), (3, 4), (3, 20), (4, 4), (4, 7), (1, 24), (2, 20), (3, 1), (3, 1))
#: So many answers of each unit are remembered.
_REMEMBERED: Final = 4000


@dataclass
class Backlog:
    """Requests that a device has had without a pause in which it owed nothing; when one of them was spoilt last."""

    spoilt_at: float = -inf


@dataclass
class Frame:
    """Something on the wire. An answer is `to` a request; `data` is what was meant, and `heard` what is there."""

    begins: float
    ends: float
    data: bytes
    unit: int
    pdu: bytes
    to: "Frame | None" = None
    collided: bool = False
    #: What becomes of it on the way to the monitor.
    fault: str = ""
    backlog: Backlog = field(default_factory=Backlog)


@dataclass
class World:
    """Time, dice, and the bus: `faults` is the share of the frames that meet one."""

    timing: LineTiming
    dice: random.Random
    faults: float
    now: float = 1000.0
    injected: Counter[str] = field(default_factory=Counter)
    #: What can happen to a frame on the way to the monitor, each with its weight.
    ways: dict[str, float] = field(default_factory=dict)
    #: Makes the monitor stand still.
    stand_still: Callable[[], None] = lambda: None
    #: Told of each frame when it has ended.
    listeners: list[Callable[[Frame], None]] = field(default_factory=list)
    #: By unit and response: the requests that it was given to, and when.
    given: dict[int, deque[tuple[bytes, Frame, float]]] = field(default_factory=dict)
    _events: list[tuple[float, int, Callable[[], None]]] = field(default_factory=list)
    _number: int = 0
    _on_wire: list[Frame] = field(default_factory=list)
    #: When the last frame has ended.
    quiet_since: float = 0.0

    def at(self, time: float, call: Callable[[], None]) -> None:
        self._number += 1
        heappush(self._events, (max(time, self.now), self._number, call))

    def step(self) -> None:
        """Let time pass until the next event."""
        self.now, _, call = heappop(self._events)
        call()

    def meets(self, fault: str, weight: float = 1.0) -> bool:
        """Whether this happens now."""
        happens = self.faults > 0 and self.dice.random() < self.faults * weight
        self.injected[fault] += happens
        return happens

    def encode(self, unit: int, pdu: bytes) -> bytes:
        return ascii_framing.encode(unit, pdu) if self.timing.mode == "ascii" else rtu.encode(unit, pdu)

    def given_as(self, unit: int, response: bytes) -> Iterator[tuple[Frame, float]]:
        """The requests that a unit has given this response to, and when; the last one first."""
        return ((to, at) for pdu, to, at in reversed(self.given.get(unit, ())) if pdu == response)

    @property
    def is_busy(self) -> bool:
        return bool(self._on_wire)

    def send(self, unit: int, pdu: bytes, to: Frame | None = None) -> Frame:
        """Put a frame on the wire."""
        data = self.encode(unit, pdu)
        fault = next((each for each, weight in self.ways.items() if self.meets(each, weight)), "")
        frame = Frame(self.now, self.now + len(data) * self.timing.character, data, unit, pdu, to, fault=fault)
        for other in self._on_wire:
            other.collided = frame.collided = True
            self.injected["collision"] += 1
        self._on_wire.append(frame)
        self.at(frame.ends, lambda: self._ended(frame))
        return frame

    def _ended(self, frame: Frame) -> None:
        self._on_wire.remove(frame)
        self.quiet_since = self.now
        if frame.to is not None:
            given = self.given.setdefault(frame.unit, deque(maxlen=_REMEMBERED))
            given.append((frame.pdu, frame.to, frame.ends))
        for listener in self.listeners:
            listener(frame)


class Device:
    """One unit on the bus: one request after the other, and sometimes late."""

    def __init__(self, world: World, unit: int) -> None:
        self.world, self.unit, self.window = world, unit, WINDOWS[unit]
        self._count = world.dice.randrange(1 << 16)
        self._waiting: deque[Frame] = deque()
        self._is_busy = False
        self._backlog = Backlog()
        #: Sends what is late right behind the next request on the bus.
        self._spite: Callable[[], None] | None = None
        world.listeners.append(self._hear)

    def _hear(self, frame: Frame) -> None:
        if frame.to is not None or frame.collided:
            return
        if self._spite is not None:
            spite, self._spite = self._spite, None
            self.world.at(self.world.now + 0.003, spite)
        if frame.unit != self.unit or self.world.meets("a device hears nothing", 0.5):
            return
        if self._is_busy and self.unit % 2 == 0:
            return
        self._waiting.append(frame)
        if not self._is_busy:
            self._backlog = Backlog()
        frame.backlog = self._backlog
        if frame.fault:
            self._backlog.spoilt_at = frame.ends
        if not self._is_busy:
            self._next()

    def _next(self) -> None:
        self._is_busy = bool(self._waiting)
        if not self._waiting:
            return
        world, request = self.world, self._waiting.popleft()
        response = self._respond(request.pdu)
        done = False

        def answer() -> None:
            nonlocal done
            if not done:
                done = True
                self._spite = None
                sent = world.send(self.unit, response, request)
                world.at(sent.ends + 0.002, self._after(sent))

        #: Two faults at once, because that is what a monitor has to fear: what it has not heard whole is late as well.
        weight = 0.3 / world.faults if request.fault else 1.0
        if world.meets("an answer is lost", 0.5):
            world.at(world.now + 0.02, self._next)
        elif world.meets("late, within the window", weight):
            if world.dice.random() < 0.2:
                world.stand_still()
            world.at(request.ends + self.window * world.dice.uniform(0.3, 0.97), answer)
        elif world.meets("late, right behind the next request", weight):
            self._spite = answer
            world.at(request.ends + self.window * 0.97, answer)
        elif world.meets("late, behind the window", 0.2):
            self._spite = answer if world.dice.random() < 0.5 else None
            world.at(request.ends + self.window * world.dice.uniform(1.3, 3.0), answer)
        else:
            world.at(world.now + world.dice.uniform(0.002, 0.03), answer)

    def _after(self, sent: Frame) -> Callable[[], None]:
        def after() -> None:
            if self.world.meets("an answer twice", 0.5):
                again = self.world.send(self.unit, sent.pdu, sent.to)
                self.world.at(again.ends + 0.002, self._next)
            else:
                self._next()

        return after

    def _respond(self, pdu: bytes) -> bytes:
        if self.world.meets("an exception", 0.5):
            return bytes((pdu[0] | 0x80, 2))
        asked = parse_request(pdu)
        if asked.read is None:
            return asked.data[:5]
        self._count += 1
        size = (asked.response_size or 2) - 2
        value = self._count.to_bytes(4) + bytes((self.unit,)) + asked.read.start.to_bytes(2) + bytes(250)
        return asked.response_head + (value[4 - size : 4] if size < 4 else value[:size])


class Client:
    """Asks one thing after the other, and takes the first answer that fits, as clients do."""

    def __init__(self, world: World, pause: float) -> None:
        self.world, self._pause = world, pause
        self.time_out = world.dice.uniform(0.08, 0.25)
        self._asked: tuple[int, RequestPdu] | None = None
        self._turn = 0
        #: What it asks again and again of one unit, at other addresses, and how often.
        self._burst: tuple[int, int, int] = (1, 3, 4)
        self._burst_left = 0
        self._again: tuple[int, bytes] | None = None
        world.listeners.append(self._hear)
        world.at(world.now + world.dice.random(), self._ask)

    def _ask(self) -> None:
        world = self.world
        if world.is_busy or world.now < world.quiet_since + world.timing.t35:
            world.at(world.now + world.timing.t35, self._ask)
            return
        unit, pdu = self._again or self._chosen()
        self._turn += 1
        frame = world.send(unit, pdu)
        self._asked, turn = None if unit == 0 else (unit, parse_request(pdu)), self._turn
        world.at(frame.ends + (self.time_out if unit else 0.05), lambda: self._give_up(turn, (unit, pdu)))

    def _chosen(self) -> tuple[int, bytes]:
        dice = self.world.dice
        unit = dice.choice(tuple(WINDOWS))
        address = dice.randrange(8) if dice.random() < 0.5 else 0x200 + dice.randrange(512)
        if self._burst_left:
            self._burst_left -= 1
            unit, function, count = self._burst
            return unit, bytes((function,)) + address.to_bytes(2) + count.to_bytes(2)
        if dice.random() < 0.06:
            value = dice.randbytes(2)
            writes = (b"\x06" + address.to_bytes(2) + value, b"\x10" + address.to_bytes(2) + b"\0\1\2" + value)
            return (0 if dice.random() < 0.2 else unit), dice.choice(writes)
        function, count = dice.choice(_READS)
        if dice.random() < 0.03:
            return unit, b"\x17" + address.to_bytes(2) + count.to_bytes(2) + address.to_bytes(2) + b"\0\1\2\0\7"
        self._burst = unit, function, count
        if dice.random() < 0.02:
            self._burst_left = dice.randint(5, 40)
        return unit, bytes((function,)) + address.to_bytes(2) + count.to_bytes(2)

    def _hear(self, frame: Frame) -> None:
        if frame.to is None or frame.collided or self._asked is None:
            return
        unit, asked = self._asked
        if frame.unit == unit and asked.accepts(frame.pdu) and not self.world.meets("a client hears no answer", 0.3):
            self._asked = None
            self._again = None
            self._go_on()

    def _give_up(self, turn: int, asked: tuple[int, bytes]) -> None:
        if turn == self._turn and (self._asked is not None or asked[0] == 0):
            self._asked = None
            fate = self.world.dice.random()
            self._again = asked if asked[0] and fate < 0.4 else None
            if asked[0] == self._burst[0] and fate > 0.7:
                self._burst_left = max(self._burst_left, 1)  # the same once more, at another address
            self._go_on()

    def _go_on(self) -> None:
        self._turn += 1
        dice = self.world.dice
        pause = dice.uniform(1.0, 8.0) if dice.random() < 0.003 else dice.expovariate(1.0 / self._pause)
        if self._burst_left:
            pause = min(pause, 0.005)
        self.world.at(self.world.now + self.world.timing.t35 + pause, self._ask)
