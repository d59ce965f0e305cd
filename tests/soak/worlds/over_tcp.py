"""Clients of RTU and ASCII over TCP, on a gateway that stands still now and then, at any point of its work.

Nothing in a response says what it is the answer to: as real clients do, these take the next frame that fits for the
answer to their latest request. Some send one request at a time, others several together; all ask something else, or the
same again, after a time-out. The values of registers say whose they are.
"""

import asyncio
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from struct import pack
from typing import Final

from gateway.events import ClientRejected, PartFailed
from gateway.listeners.connection import TcpConnection
from gateway.listeners.sessions.session import SENDING_DEADLINE
from gateway.listeners.tcp import TcpListener
from gateway.modbus.frame import Frame
from gateway.request import Caller, Request, Target
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.faulty import Fault
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.over_tcp import ENCODE
from soak.outside import Outside, Socket
from soak.tally import Tally

READ: Final = 0x03
WRITE: Final = 0x06
ILLEGAL_ADDRESS: Final = bytes((READ | 0x80, 0x02))
#: What the gateway itself may answer for a device.
FAILURES: Final = frozenset({0x06, 0x0A, 0x0B})
IMAGE: Final = 200
#: Registers up to here have values of their own; from there on they are written; there are ITEMS.
WRITTEN: Final = 100
ITEMS: Final = 200
CLIENTS: Final = 8
#: The shortest time-out that a client can have whom no stand-still harms, and the longest here, in seconds.
SHORTEST: Final = 0.101
LONGEST: Final = 0.8
#: Nothing is under way any more after so many seconds.
PATIENCE: Final = 5.0
#: Why a client may be closed that has sent noise, if the gateway stands still whenever a silence could end it.
NEVER_QUIET: Final = f"sent no whole request within {SENDING_DEADLINE:g} s"
#: Clients send so many requests together, within so many seconds; a network delays a part of another one by so much.
MOST_TOGETHER: Final = 6
AT_ONCE: Final = 0.04
DELAYED: Final = 0.2

CONFIG: Final = f"""
[[listen]]
bind = "rtu+tcp://127.0.0.1:0"

[[listen]]
bind = "ascii+tcp://127.0.0.1:0"
in_flight = {MOST_TOGETHER}

[[line]]
port = "/dev/rtu"
baud = 115200
devices = [{{ unit = "1-2", timeout = "1 s" }}]

[[line]]
port = "/dev/ascii"
mode = "ascii"
baud = 115200
devices = [{{ unit = "3-4", timeout = "1 s" }}]

[[image]]
unit = {IMAGE}
holding = {ITEMS}
initial.holding = [{{ at = 0, values = {[IMAGE << 8 | address for address in range(WRITTEN)]} }}]
"""
LINES: Final = {"rtu": (1, 2), "ascii": (3, 4)}

#: What meets a request, by its weight. Of an image no device is slow.
FAULTS: Final = {"in pieces": 4, "slow device": 8, "silent device": 1, "busy": 1, "stand-still": 2, "noise": 1}
#: Where the gateway may stand still: between two of its steps, or within one.
AT_ANY_TIME: Final = "at any time"
POINTS: Final = (
    *(AT_ANY_TIME, "before it looks", "when it has read", "in the turn after it has read"),
    *("before it hands a request on", "when it has handed a request on"),
)


@dataclass(slots=True)
class Question:
    """A request of a client, and the only answer with data, or exception of the unit, that is right."""

    unit: int
    pdu: bytes
    answer: bytes
    fault: str = Fault.NONE
    #: Which byte of the client's is its last one.
    ends_at: int = 0

    def is_fitting(self, frame: Frame) -> bool:
        """Whether a client can take a frame for the answer."""
        unit, pdu = frame
        if unit != self.unit or pdu[0] & 0x7F != self.pdu[0]:
            return False
        return len(pdu) == 2 or (pdu == self.pdu if self.pdu[0] == WRITE else len(pdu) == len(self.answer))


class _Device(SimulatedDevice):
    """One whose registers say whose they are; it is slow or silent when it was told so."""

    def __init__(self, unit: int) -> None:
        super().__init__(unit, items=ITEMS)
        self.holding[:WRITTEN] = [unit << 8 | address for address in range(WRITTEN)]
        self.next_fault = ""

    def ask(self, frame: Frame, encode: Callable[[int, bytes], bytes]) -> list[Answer]:
        fault, self.next_fault = self.next_fault, ""
        self.delay = random.Random(frame.pdu).uniform(0.05, 0.9) if fault == "slow device" else 0.005
        self.silent = fault == "silent device"
        self.heard.clear()
        return super().ask(frame, encode)


class World:
    """What the clients share."""

    def __init__(self, bench: GatewayBench, seed: int, share: float, goal: int) -> None:
        self.tally = Tally()
        self.dice = random.Random(seed)
        self.outside = Outside()
        self.share = share
        self.goal = goal
        #: Writes that were given up before the gateway had read them: it must not carry them out.
        self.never: set[tuple[int, bytes]] = set()
        self.devices = {unit: _Device(unit) for units in LINES.values() for unit in units}
        for line, units in LINES.items():
            bench.attach(line, SimulatedLine(line, *(self.devices[unit] for unit in units)))
        self._written = 0

    @property
    def is_over(self) -> bool:
        """Whether there were enough requests."""
        return self.tally.transactions >= self.goal

    def think_of_one(self) -> Question:
        """A question for one of the units."""
        dice = self.dice
        unit = IMAGE if dice.random() < 0.5 else dice.choice(list(self.devices))
        kind = dice.random()
        if kind < 0.2:
            self._written += 1
            address, value = WRITTEN + self._written % (ITEMS - WRITTEN), self._written // (ITEMS - WRITTEN)
            pdu = pack(">BHH", WRITE, address, value)
            return Question(unit, pdu, pdu)
        if kind < 0.25:
            return Question(unit, pack(">BHH", READ, dice.randrange(ITEMS, 1000), 1), ILLEGAL_ADDRESS)
        address = dice.randrange(WRITTEN)
        return Question(unit, pack(">BHH", READ, address, 1), pack(">BBH", READ, 2, unit << 8 | address))

    def take_events(self, bench: GatewayBench) -> None:
        """Count the events so far."""
        for event in bench.events:
            self.tally.events[event.name] += 1
            if isinstance(event, PartFailed) or (isinstance(event, ClientRejected) and event.reason != NEVER_QUIET):
                self.tally.complain(repr(event))
        bench.events.clear()

    def meet(self, question: Question) -> None:
        """Perhaps something happens to a request that is about to be sent."""
        fault = Fault.NONE.value
        if self.dice.random() < self.share:
            (fault,) = self.dice.choices(list(FAULTS), list(FAULTS.values()))
        if fault == "stand-still":
            fault += " " + self._let_stand_still()
        elif fault == "busy":
            for _ in range(9):
                self._let_stand_still_soon(self.dice.uniform(0.001, 0.045))
        elif fault.endswith("device") and question.unit in self.devices:
            self.devices[question.unit].next_fault = fault
        question.fault = fault
        self.tally.injected[fault] += 1
        self.tally.transactions += 1

    def _let_stand_still(self) -> str:
        """Let the gateway stand still once; where."""
        point = self.dice.choice(POINTS)
        seconds = self.dice.choice((0.06, 0.3, 1.5)) * self.dice.uniform(0.3, 1.0)
        if point == AT_ANY_TIME:
            self._let_stand_still_soon(seconds)
        else:
            self.outside.armed = point, seconds
        return point

    def _let_stand_still_soon(self, seconds: float) -> None:
        soon = self.dice.uniform(0.0, LONGEST)
        asyncio.get_running_loop().call_later(soon, self.outside.stand_still, seconds)


class _Router(Target):
    """The gateway's router, and who looks at what it is handed."""

    def __init__(self, world: World, listener: TcpListener) -> None:
        self._world = world
        self._router = listener.router

    def submit(self, request: Request, now: float) -> None:
        if (request.unit, request.pdu) in self._world.never:
            self._world.tally.complain(f"{request} is handed on; it was given up before it was read")
        self._world.outside.pass_by("before it hands a request on")
        self._router.submit(request, now)
        if not request.is_over:
            self._world.outside.pass_by("when it has handed a request on")


class Client:
    """A client that takes what fits for the answer to the first of its latest requests."""

    def __init__(self, world: World, listener: TcpListener, number: int) -> None:
        loop = asyncio.get_running_loop()
        scheme = listener.settings.scheme
        self._world = world
        self._tally = world.tally
        self._outside = world.outside
        self._dice = random.Random(world.dice.random())
        self._name = f"{scheme} client {number}"
        self._encode, self._decode = ENCODE[scheme], DECODE[scheme]
        self._sends_together = number % 3 == 2
        #: The requests that it has sent at last, those of them whose answers it awaits, and those that it has given up.
        self._asked: list[Question] = []
        self._awaited: deque[Question] = deque()
        self._given_up: list[Question] = []
        self._round = 0
        self._asked_at = self._sent_at = self._answered_at = self._noise_until = 0.0
        caller = Caller(f"10.0.0.{number}:49152", "127.0.0.1", "127.0.0.1")
        connection = TcpConnection(listener, caller, loop.time, _Router(world, listener))
        self._socket = Socket(self._outside, self._dice, connection, self._heard)
        connection.connection_made(self._socket)
        self._socket.resume_reading()
        self._outside.call_later(self._dice.random(), self._ask)

    @property
    def _is_served(self) -> bool:
        """Whether it has had an answer since the gateway stood still, or since noise: then there must be one."""
        return self._answered_at > max(self._outside.goes_on_at, self._noise_until)

    def _ask(self, *, again: bool = False) -> None:
        """Ask something else, or the same `again`, writes left out."""
        if self._world.is_over:
            return
        for question in self._given_up:
            if question.pdu[0] == WRITE and self._socket.read < question.ends_at:
                self._world.never.add((question.unit, question.pdu))
        number = self._dice.randint(2, MOST_TOGETHER) if self._sends_together else 1
        same = [question for question in self._asked if question.pdu[0] != WRITE] if again else []
        self._asked = same or [self._world.think_of_one() for _ in range(number)]
        self._given_up, self._awaited = [], deque(self._asked)
        self._round += 1
        self._asked_at = self._sent_at = self._outside.now
        self._send()
        time_out = self._sent_at - self._asked_at + self._dice.uniform(SHORTEST, LONGEST)
        self._outside.call_later(time_out, partial(self._time_out, self._round))

    def _send(self) -> None:
        """Send what is asked, perhaps in pieces."""
        data, cuts = b"", []
        for question in self._asked:
            self._world.meet(question)
            adu = self._encode(question.unit, question.pdu)
            if question.fault == "noise":
                data += self._dice.randbytes(self._dice.randint(1, 20))
                self._noise_until = self._outside.now + LONGEST
            if question.fault == "in pieces" or (self._sends_together and self._dice.random() < 0.3):
                cuts.append(len(data) + self._dice.randrange(1, len(adu)))
            data += adu
            question.ends_at = self._socket.sent + len(data)
        delays = sorted(self._dice.uniform(0.0, AT_ONCE if self._sends_together else DELAYED) for _ in cuts)
        for delay, begin, end in zip([0.0, *delays], [0, *cuts], [*cuts, len(data)], strict=True):
            self._outside.call_later(delay, partial(self._socket.arrive, data[begin:end]))
            self._sent_at = self._asked_at + delay

    def _time_out(self, number: int) -> None:
        if number != self._round or not self._awaited:
            return
        self._tally.abandoned += len(self._awaited)
        if self._is_served and all(question.unit == IMAGE for question in self._asked):
            self._tally.complain(f"at {self._outside.now:.6f} s {self._name} got no answer to {self._asked}")
        self._given_up, self._awaited = [*self._awaited], deque()
        ask = partial(self._ask, again=self._dice.random() < 0.3)
        self._outside.call_later(self._dice.choice((0.0, 0.0, 0.2)), ask)

    def _heard(self, data: bytes) -> None:
        for frame in self._decode(data):
            if self._awaited and self._awaited[0].is_fitting(frame):
                self._judge(self._awaited.popleft(), frame.pdu)
                if not self._awaited:
                    pause = self._dice.choice((0.0, 0.01, 0.05, 0.2))
                    self._outside.call_later(max(pause, self._sent_at - self._outside.now), self._ask)

    def _judge(self, question: Question, pdu: bytes) -> None:
        self._answered_at = now = self._outside.now
        outcome = "WRONG"
        if pdu == question.answer:
            outcome = "device's exception" if len(pdu) == 2 else "right data"
        elif len(pdu) == 2 and pdu[1] in FAILURES and question.unit != IMAGE:
            outcome = f"{pdu[1]:02X}"
        self._tally.outcomes[question.fault, outcome] += 1
        self._tally.slowest = max(self._tally.slowest, now - self._asked_at)
        if outcome == "WRONG":
            self._tally.complain(
                f"at {now:.6f} s {self._name} asked {question.unit}: {question.pdu.hex(' ').upper()} "
                f"and got {pdu.hex(' ').upper()} ({question.fault}); the gateway went on at "
                f"{self._outside.goes_on_at:.6f} s"
            )


def _frames_of_rtu(data: bytes) -> list[Frame]:
    frames = []
    while data:
        size = 5 if data[1] & 0x80 else 8 if data[1] == WRITE else 5 + data[2]
        frames.append(Frame(data[0], data[1 : size - 2]))
        data = data[size:]
    return frames


def _frames_of_ascii(data: bytes) -> list[Frame]:
    bodies = [bytes.fromhex(line[1:].decode()) for line in data.splitlines()]
    return [Frame(body[0], body[1:-1]) for body in bodies]


DECODE: Final = {"rtu+tcp": _frames_of_rtu, "ascii+tcp": _frames_of_ascii}


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time. A transaction is a request that a client has sent."""
    async with gateway_bench(CONFIG) as bench:
        world = World(bench, seed, share, transactions)
        listeners = bench.gateway.listeners
        for listener in listeners:
            listener.start()
        for number in range(CLIENTS):
            Client(world, listeners[number % len(listeners)], number)
        while not world.is_over:
            await asyncio.sleep(1.0)
            world.take_events(bench)
        await asyncio.sleep(PATIENCE)
        for listener in listeners:
            listener.close()
        world.take_events(bench)
    tally = world.tally
    tally.questions = tally.transactions
    tally.virtual_seconds = world.outside.now
    return tally
