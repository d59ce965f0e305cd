"""A client never receives data that is not the answer to its own request: a long run over lines full of faults.

    .venv/bin/python tests/soak/never_lies.py --transactions 1000000 --faults 20% --seed 1 --jobs 2

A whole gateway in virtual time: RTU and ASCII lines with devices whose values say whose they are, clients that read and
write without pause, another client on each line, adapters that cut and join what they hear, adapters that are pulled,
clients that leave. Every answer is compared with what can be true at
that moment. Ends with status 0 if no answer was wrong and every request was answered exactly once. The same seed gives
the same run.
"""

import argparse
import asyncio
import random
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from gateway.events import PartFailed
from gateway.lines.transaction import Transaction
from gateway.listeners.mbap import MbapSession
from gateway.modbus import mbap
from gateway.modbus.chartime import CharacterFormat, LineTiming
from gateway.modbus.codes import Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import pack_bits, unpack_bits
from gateway.ports.memory import MemoryLine
from gateway.ports.port import OpenPort, Port, PortUser, SerialSettings
from gateway.service.status import status
from gateway.service.supervisor import keep_lines_open
from kit.faulty import OWN_FUNCTION, Fault, FaultyDevice, FaultyLine, bit, word
from kit.house import House
from kit.stranger import Adapter, Stranger
from kit.virtual_time import VirtualTimeLoop

CLIENTS: Final = 24
UNITS: Final = range(1, 9)
#: From here on each client has 8 holding registers and 8 coils of each device that nobody else writes; the last
#: register is written by broadcasts only.
OWN: Final = 256
OWN_ITEMS: Final = 8
#: Units 7 and 8 may take so many times as long as the others.
SLOW: Final = 4
#: Another client asks on each line, on average after so many seconds of quiet.
STRANGERS_PAUSE: Final = 0.3
#: No request takes longer in virtual seconds: `max_wait`, a late window, the slowest line's longest exchange.
PATIENCE: Final = 5.0

#: What the gateway itself may answer to a request that it has not sent; 0B may follow on one that was.
NOT_SENT: Final = frozenset({0x06, 0x0A})
NO_ANSWER: Final = 0x0B

LEFT_OUT: Final = """\
Left out, because nobody can detect it on RTU and ASCII:
  - a response of the same shape that comes later than the late window
  - a duplicate that falls inside the next transaction of the same shape, of ours or of another client
  - the answer to another client whose request was not heard whole
and damage that the check sum itself cannot show (random damage: 1 in 65536 on RTU, 1 in 256 on ASCII)"""


@dataclass(frozen=True)
class LineKind:
    """One line of the soak. `real` ports take time to send, as a UART does."""

    name: str
    timing: LineTiming
    timeout: float
    real: bool = True
    echo: bool = False
    late_window: float | None = None
    more: str = ""

    @property
    def config(self) -> str:
        """Its table in the config file; clients know unit 3 of the second line as 13."""
        first = 10 * LINES.index(self)
        window = "" if self.late_window is None else f'late_window = "{1000 * self.late_window:g} ms"'
        return f"""
            [[line]]
            name    = "{self.name}"
            port    = "/dev/{self.name}"
            mode    = "{self.timing.mode}"
            baud    = {self.timing.baud}
            format  = "{self.timing.format}"
            latency = "5 ms"
            echo    = {str(self.echo).lower()}
            devices = [
              {{ unit = 1, as = {first + 1}, timeout = "{1000 * self.timeout:g} ms", priority = "high" }},
              {{ unit = "2-6", as = "{first + 2}-{first + 6}", timeout = "{1000 * self.timeout:g} ms" }},
              {{ unit = "7-8", as = "{first + 7}-{first + 8}", timeout = "{1000 * SLOW * self.timeout:g} ms" }},
            ]
            {window}
            {self.more}
            """


RTU, ASCII = CharacterFormat.parse("8E1"), CharacterFormat.parse("7E1")
LINES: Final = (
    LineKind("rtu", LineTiming("rtu", 19200, RTU), 0.05),
    LineKind("rtu-retries", LineTiming("rtu", 9600, RTU), 0.08, more="retries = 1\nqueue = 12"),
    LineKind("rtu-virtual", LineTiming("rtu", 115200, RTU), 0.03, real=False, late_window=0.3),
    LineKind("rtu-echo", LineTiming("rtu", 38400, RTU), 0.04, echo=True),
    LineKind("ascii", LineTiming("ascii", 19200, ASCII), 0.05),
    LineKind("ascii-echo", LineTiming("ascii", 38400, ASCII), 0.1, echo=True, more="coalesce = false\nretries = 1"),
)
CONFIG: Final = '[[listen]]\nbind = "tcp://127.0.0.1:0"\nunit0 = "broadcast"\n' + "".join(line.config for line in LINES)
#: Of each unit that clients use: its device's number.
NUMBERS: Final = {10 * at + unit: len(UNITS) * at + unit - 1 for at in range(len(LINES)) for unit in UNITS}


class _RealLine(MemoryLine):
    """A line behind a serial port, where no answer comes before its request has left."""

    async def open_port(self, user: PortUser) -> Port:
        port = await super().open_port(user)
        port.virtual = False
        return port


class _House(House):
    def _open(self, settings: SerialSettings) -> OpenPort:
        name = settings.port.removeprefix("/dev/")
        kind = next(line for line in LINES if line.name == name)
        line = (_RealLine if kind.real else MemoryLine)(settings.port, settings.latency)
        return self.lines.setdefault(name, line).open_port


class Item:
    """What a register or coil that clients write can hold at the moment, as far as clients can know."""

    __slots__ = ("pending", "possible", "watchers")

    def __init__(self, value: int) -> None:
        self.possible = {value}
        #: A write is under way.
        self.pending = False
        #: What others who are just reading it may be answered.
        self.watchers: list[set[int]] = []

    def writing(self, values: set[int]) -> None:
        """A write has been asked for, of one of these values."""
        self.pending = True
        for watcher in self.watchers:
            watcher.update(values)

    def written(self, values: set[int], *, sure: bool) -> None:
        """The write was answered: it has happened, or nobody knows."""
        self.pending = False
        self.possible = values if sure else self.possible | values


#: Says what is wrong with the data of a response, None if nothing is.
Check = Callable[[bytes], str | None]


@dataclass(slots=True)
class Question:
    """A request under way. `settle` is told how it ended: 'done', 'not sent' or 'unknown'."""

    unit: int
    pdu: bytes
    check: Check
    settle: Callable[[str], None] | None = None
    asked_at: float = 0.0
    #: What happened to it on the line, the last time; how often it was there, and the exceptions that it was answered.
    fault: Fault | None = None
    codes: set[int | None] = field(default_factory=set)
    tries: int = 0


@dataclass
class Tally:
    """What was injected and what came of it; of one run or of several."""

    transactions: int = 0
    questions: int = 0
    broadcasts: int = 0
    abandoned: int = 0
    #: What other clients have asked on the lines.
    strangers: int = 0
    injected: Counter[str] = field(default_factory=Counter)
    #: Fault and outcome of every answered question.
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    wrong_count: int = 0
    slowest: float = 0.0
    virtual_seconds: float = 0.0

    def add(self, other: "Tally") -> None:
        """Take in another run."""
        for name in (
            "transactions",
            "questions",
            "broadcasts",
            "abandoned",
            "strangers",
            "wrong_count",
            "virtual_seconds",
        ):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("injected", "outcomes", "events", "counts"):
            getattr(self, name).update(getattr(other, name))
        self.wrong += other.wrong
        self.slowest = max(self.slowest, other.slowest)

    @property
    def _share_answered(self) -> float:
        """How many of the requests without a fault were answered with data."""
        return self.outcomes[Fault.NONE, "right data"] / max(self.injected[Fault.NONE], 1)

    def complain(self, text: str) -> None:
        """Something was wrong or lost."""
        self.wrong_count += 1
        if len(self.wrong) < 20:
            self.wrong.append(text)

    def __str__(self) -> str:
        columns = ("right data", "device's exception", "0B", "06", "0A", "WRONG")
        rows = [_row("fault", "injected", columns)]
        for fault in [*(each.value for each in Fault), "(not sent)"]:
            cells = [self.outcomes[fault, column] for column in columns]
            if self.injected[fault] or any(cells):
                rows.append(_row(fault, self.injected[fault] or "", cells))
        totals = [sum(count for (_, name), count in self.outcomes.items() if name == column) for column in columns]
        rows.append(_row("all", self.injected.total(), totals))
        faults = self.injected.total() - self.injected[Fault.NONE]
        rows += [
            "",
            f"{self.questions} requests of clients, {self.abandoned} of which they left; {self.broadcasts} broadcasts",
            f"{self.transactions} transactions on lines, {faults} of them with a fault",
            f"{self.strangers} of other clients; {self._share_answered:.1%} of ours without a fault were answered",
            "lines: " + ", ".join(f"{name} {count}" for name, count in sorted(self.counts.items()) if count),
            "events: " + ", ".join(f"{name} {count}" for name, count in sorted(self.events.items())),
            f"{self.virtual_seconds:.0f} s of the lines' time; slowest answer {1000 * self.slowest:.0f} ms",
            f"wrong or lost: {self.wrong_count}",
        ]
        return "\n".join(rows)


def _row(fault: str, injected: object, cells: Sequence[object]) -> str:
    right, exception, *codes = cells
    return f"{fault:28}{injected:>10}{right:>12}{exception:>20}" + "".join(f"{code:>9}" for code in codes)


class World:
    """Everything that the clients share: devices as they can be, and the tally."""

    def __init__(self, home: House, seed: int, share: float, goal: int) -> None:
        self.home = home
        self.loop = asyncio.get_running_loop()
        self.tally = Tally()
        self.goal = goal
        self.dice = random.Random(seed)
        self.registers: dict[tuple[int, int], Item] = {}
        self.coils: dict[tuple[int, int], Item] = {}
        for number in NUMBERS.values():
            for address in range(OWN, OWN + OWN_ITEMS * CLIENTS):
                self.registers[number, address] = Item(word(number, Area.HOLDING, address))
                self.coils[number, address] = Item(bit(number, Area.COILS, address))
        self.clients: dict[str, Client] = {}
        self.lines: list[FaultyLine] = []
        self.strangers: list[Stranger] = []
        self.adapters: dict[str, Adapter] = {}
        #: What passed on each line lately: when, `>>` sent or `<<` received, and the fault that was injected.
        self.passed: dict[str, deque[tuple[float, str, bytes, str]]] = {name: deque(maxlen=24) for name in home.lines}
        self._pulls: dict[str, int] = dict.fromkeys(home.lines, 0)
        self._value = 0
        for at, kind in enumerate(LINES):
            self._attach(at, kind, seed, share)

    @property
    def is_over(self) -> bool:
        """Whether there have been enough transactions."""
        return self.tally.transactions >= self.goal

    def new_value(self) -> int:
        """A register value that has not been written for long."""
        self._value = (self._value + 1) & 0xFFFF
        return self._value

    def _attach(self, at: int, kind: LineKind, seed: int, share: float) -> None:
        devices = [
            FaultyDevice(unit, number=NUMBERS[10 * at + unit], timeout=kind.timeout * (SLOW if unit > 6 else 1))
            for unit in UNITS
        ]
        faulty = FaultyLine(
            kind.timing, *devices, share=share, seed=100 * seed + at, echo=kind.echo, late_window=kind.late_window
        )
        self.lines.append(faulty)
        line, name, passed = self.home.lines[kind.name], kind.name, self.passed[kind.name]

        deliver = self._plug_in(at, kind, faulty, seed)

        def answer(data: bytes) -> None:
            line.written.clear()
            self.tally.transactions += 1
            now = self.loop.time()
            answers = faulty.received(data, now)
            faulty.heard_at = max(faulty.heard_at, now + len(data) * kind.timing.character)
            passed.append((now, ">>", data, faulty.last.fault))
            for delay, response in answers:
                self.loop.call_later(delay, deliver, self._pulls[name], response)

        def observe(transaction: Transaction, response: Frame | None, now: float) -> None:
            tries = 1 + transaction.retries
            codes = {injection.code for injection in list(faulty.latest)[-tries:]}
            for request in transaction.requests:
                client = self.clients.get(request.origin.client)
                if client is not None and (question := client.open.get(request.transaction)) is not None:
                    question.fault, question.codes, question.tries = faulty.last.fault, codes, tries

        line.on_write = answer
        self.home.gateway.lines[at].driver.line.observer = observe

    def _plug_in(self, at: int, kind: LineKind, faulty: FaultyLine, seed: int) -> Callable[[int, bytes], None]:
        """Let a line be heard through its adapter, another client on it included; for what comes while it is there."""
        line, name = self.home.lines[kind.name], kind.name

        def hand_over(data: bytes) -> None:
            self.passed[name].append((self.loop.time(), "<<", data, ""))
            line.deliver(data)

        adapter = self.adapters[name] = Adapter(self.loop.call_later, hand_over, seed=100 * seed + at)

        def deliver(pulls: int, data: bytes) -> None:
            if pulls == self._pulls[name]:
                faulty.heard_at = self.loop.time()
                adapter.take(data, at_once=faulty.heard_at < faulty.spurious_until)

        stranger = Stranger(faulty, seed=100 * seed + at)
        self.strangers.append(stranger)

        def strangers_turn() -> None:
            now = self.loop.time()
            wait = 0.1 if self._pulls[name] % 2 else stranger.may_begin_at - now
            if self.is_over:
                return
            if wait > 0.0:
                self.loop.call_later(wait + self.dice.uniform(0.0, 0.001), strangers_turn)
                return
            for delay, data in stranger.asks(now):
                self.loop.call_later(delay, deliver, self._pulls[name], data)
            self.loop.call_later(self.dice.expovariate(1 / STRANGERS_PAUSE), strangers_turn)

        self.loop.call_later(self.dice.uniform(0.0, STRANGERS_PAUSE), strangers_turn)
        return deliver

    async def pull_adapters(self) -> None:
        """Now and then one line has no adapter for a while; what was under way to it is lost."""
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(5.0, 40.0))
            name = self.dice.choice(list(self.home.lines))
            self._pulls[name] += 1
            self.adapters[name].drop()
            self.home.lines[name].pull()
            await asyncio.sleep(self.dice.uniform(0.001, 2.0))
            self.home.lines[name].plug()
            await asyncio.sleep(2.0)  # until it is open again
            self._pulls[name] += 1

    def story(self, unit: int) -> str:
        """What passed lately on the line of a unit."""
        kind = LINES[unit // 10]
        show = repr if kind.timing.mode == "ascii" else lambda data: data.hex(" ").upper()
        return "\n".join(
            f"    {at:.6f} {kind.name} {way} {show(data)} {fault}" for at, way, data, fault in self.passed[kind.name]
        )

    def take_events(self) -> None:
        """Count the events so far."""
        for event in self.home.events:
            self.tally.events[event.name] += 1
            if isinstance(event, PartFailed):
                self.tally.complain(f"a defect: {event.error}\n{event.traceback}")
        self.home.events.clear()


class Client:
    """A connection that always has some requests under way, and checks every answer."""

    def __init__(self, world: World, number: int) -> None:
        self.open: dict[int, Question] = {}
        self._world = world
        self._tally = world.tally
        self._loop = world.loop
        self._number = number
        self._dice = random.Random(world.dice.random())
        self._own = OWN + OWN_ITEMS * number
        self._transaction = 0
        self._connections = 0
        self._units = list(NUMBERS)
        self._connect()

    def _connect(self) -> None:
        self._connections += 1
        listener = self._world.home.gateway.listeners[0]
        name = f"10.0.0.{self._number}:{self._connections}"
        self._session = MbapSession(
            name,
            host="127.0.0.1",
            router=listener.router,
            connection=self,
            settings=listener.settings,
            now=self._loop.time(),
        )
        self._world.clients[name] = self
        for _ in range(self._dice.randint(1, 4)):
            self._loop.call_later(self._dice.uniform(0.0, 0.05), self._ask_for, self._session)

    def _leave(self) -> None:
        """Close the connection, whatever is under way, and come back."""
        self._session.closed()
        del self._world.clients[self._session.client]
        for question in self.open.values():
            self._tally.abandoned += 1
            if question.settle is not None:
                question.settle("unknown")
        self.open.clear()
        self._connect()

    # --- what the session sees ---

    def send(self, data: bytes) -> None:
        while data:
            transaction, size = int.from_bytes(data[:2]), 6 + int.from_bytes(data[4:6])
            self._answered(transaction, data[6], data[7:size])
            data = data[size:]

    def pause(self) -> None:
        pass

    def resume(self) -> None:
        session = self._session
        self._loop.call_soon(lambda: session.proceed(self._loop.time()))

    def close(self) -> None:
        self._session.closed()

    def reject(self, reason: str) -> None:
        self._tally.complain(f"client {self._number} was rejected: {reason}")

    # --- asking ---

    def _ask_for(self, session: MbapSession) -> None:
        if session is not self._session or self._world.is_over:
            return
        if self._dice.random() < 0.0005:
            self._leave()
            return
        question = self._think_of_one()
        question.asked_at = self._loop.time()
        self._transaction = self._transaction + 1 & 0xFFFF
        if question.unit:
            self._tally.questions += 1
            self.open[self._transaction] = question
        else:
            self._loop.call_later(0.2, self._ask_for, session)
        adu = mbap.encode(self._transaction, question.unit, question.pdu)
        session.room()[: len(adu)] = adu
        session.received(len(adu), question.asked_at)

    def _answered(self, transaction: int, unit: int, pdu: bytes) -> None:
        question = self.open.pop(transaction, None)
        if question is None:
            self._tally.complain(f"client {self._number}: answer to {transaction}, which is not open: {pdu.hex(' ')}")
            return
        now = self._loop.time()
        self._tally.slowest = max(self._tally.slowest, now - question.asked_at)
        outcome, fate, trouble = self._judge(question, unit, pdu)
        if question.settle is not None:
            question.settle(fate)
        row = "(not sent)" if question.fault is None else question.fault.value
        self._tally.outcomes[row, "WRONG" if trouble else outcome] += 1
        if trouble:
            self._tally.complain(
                f"at {now:.6f} s client {self._number} asked {question.unit}: {question.pdu.hex(' ').upper()} and got "
                f"{unit}: {pdu.hex(' ').upper()}: {trouble} ({row}, on the line {question.tries} times)\n"
                + self._world.story(unit)
            )
        pause = self._dice.uniform(0.0, 0.02) if outcome == "right data" else self._dice.uniform(0.02, 0.2)
        self._loop.call_later(pause, self._ask_for, self._session)

    def _judge(self, question: Question, unit: int, pdu: bytes) -> tuple[str, str, str | None]:
        """The outcome for the table, how a write ended, and what is wrong."""
        function = question.pdu[0]
        if unit != question.unit:
            return "WRONG", "unknown", "another unit"
        if pdu[0] == function | 0x80 and len(pdu) == 2:
            return self._judge_exception(question, pdu[1])
        if question.fault is None:
            return "WRONG", "unknown", "the question was on no line"
        if pdu[0] != function:
            return "WRONG", "unknown", "another function"
        if question.settle is not None:  # before the check: FC23 reads what it has written
            question.settle("done")
            question.settle = None
        return "right data", "done", question.check(pdu)

    def _judge_exception(self, question: Question, code: int) -> tuple[str, str, str | None]:
        if question.fault is None:
            known = code in NOT_SENT or code == NO_ANSWER
            fate = "not sent" if code in NOT_SENT else "unknown"
            return f"{code:02X}", fate, None if known else "an exception of nobody"
        if code == NO_ANSWER:
            return "0B", "unknown", None
        trouble = None if code in question.codes else "an exception that the device did not answer with"
        return "device's exception", "not sent", trouble

    # --- questions ---

    def _think_of_one(self) -> Question:
        kind = self._dice.choices(_KINDS, cum_weights=_WEIGHTS)[0]
        unit = self._dice.choice(self._units)
        return kind(self, unit, NUMBERS[unit])

    def _read_registers(self, unit: int, number: int) -> Question:
        function = self._dice.choice((3, 3, 4))
        # Few different ones, so that clients ask the same, and the same shape, at the same time.
        start, count = self._dice.choice(_SPANS)
        data = _static_words(number, Area.INPUT if function == 4 else Area.HOLDING, start, count)
        return Question(unit, _words(function, start, count), _expect(bytes((function, len(data))) + data))

    def _read_bits(self, unit: int, number: int) -> Question:
        function = self._dice.choice((1, 2))
        start, count = self._dice.choice(_BIT_SPANS)
        data = _static_bits(number, Area.COILS if function == 1 else Area.DISCRETE, start, count)
        return Question(unit, _words(function, start, count), _expect(bytes((function, len(data))) + data))

    def _read_own(self, unit: int, number: int) -> Question:
        """A client's requests to one unit keep their order: what it sees is what its last write left."""
        first = self._own + self._dice.randrange(OWN_ITEMS)
        count = self._dice.randint(1, self._own + OWN_ITEMS - first)
        items = [self._world.registers[number, address] for address in range(first, first + count)]
        return Question(
            unit, _words(3, first, count), lambda pdu: _not_possible(pdu, [item.possible for item in items])
        )

    def _read_own_coils(self, unit: int, number: int) -> Question:
        items = [self._world.coils[number, address] for address in range(self._own, self._own + OWN_ITEMS)]

        def check(pdu: bytes) -> str | None:
            bits = unpack_bits(pdu[2:], OWN_ITEMS)
            fits = len(pdu) == 3 and all(value in item.possible for value, item in zip(bits, items, strict=True))
            return None if fits else f"the coils can be {[item.possible for item in items]}"

        return Question(unit, _words(1, self._own, OWN_ITEMS), check)

    def _read_others(self, unit: int, number: int) -> Question:
        """The answer is newer than the question: not what it held before the last write that was confirmed by then."""
        address = OWN + OWN_ITEMS * self._dice.randrange(CLIENTS) + self._dice.randrange(2)
        item = self._world.registers[number, address]
        if item.pending:
            return self._read_registers(unit, number)
        watcher = set(item.possible)
        item.watchers.append(watcher)

        def settle(fate: str) -> None:
            item.watchers = [each for each in item.watchers if each is not watcher]

        return Question(unit, _words(3, address, 1), lambda pdu: _not_possible(pdu, [watcher]), settle)

    def _write_register(self, unit: int, number: int) -> Question:
        address = self._own + self._dice.randrange(OWN_ITEMS - 1)
        item = self._world.registers[number, address]
        if item.pending:
            return self._read_own(unit, number)
        value = self._world.new_value()
        pdu = _words(6, address, value)
        return Question(unit, pdu, _expect(pdu), _settle([item], [{value}]))

    def _mask_register(self, unit: int, number: int) -> Question:
        address = self._own + self._dice.randrange(OWN_ITEMS - 1)
        item = self._world.registers[number, address]
        if item.pending or len(item.possible) > 4:
            return self._write_register(unit, number)
        mask, value = 0xFF00, self._world.new_value()
        pdu = _words(22, address, mask, value)
        return Question(
            unit, pdu, _expect(pdu), _settle([item], [{old & mask | value & ~mask for old in item.possible}])
        )

    def _write_registers(self, unit: int, number: int) -> Question:
        items, first, values = self._own_values(number)
        if not items:
            return self._read_own(unit, number)
        pdu = _words(16, first, len(items)) + bytes((2 * len(items),)) + b"".join(each.to_bytes(2) for each in values)
        return Question(unit, pdu, _expect(pdu[:5]), _settle(items, [{value} for value in values]))

    def _write_and_read(self, unit: int, number: int) -> Question:
        items, first, values = self._own_values(number)
        if not items:
            return self._read_own(unit, number)
        data = b"".join(each.to_bytes(2) for each in values)
        pdu = _words(23, first, len(items), first, len(items)) + bytes((len(data),)) + data
        return Question(
            unit, pdu, _expect(bytes((23, len(data))) + data), _settle(items, [{value} for value in values])
        )

    def _own_values(self, number: int) -> tuple[list[Item], int, list[int]]:
        first = self._own + self._dice.randrange(OWN_ITEMS - 1)
        count = self._dice.randint(1, self._own + OWN_ITEMS - 1 - first)
        items = [self._world.registers[number, address] for address in range(first, first + count)]
        if any(item.pending for item in items):
            return [], 0, []
        return items, first, [self._world.new_value() for _ in items]

    def _write_coil(self, unit: int, number: int) -> Question:
        address = self._own + self._dice.randrange(OWN_ITEMS)
        item = self._world.coils[number, address]
        if item.pending:
            return self._read_own_coils(unit, number)
        value = self._dice.randrange(2)
        pdu = _words(5, address, 0xFF00 * value)
        return Question(unit, pdu, _expect(pdu), _settle([item], [{value}]))

    def _write_coils(self, unit: int, number: int) -> Question:
        items = [self._world.coils[number, address] for address in range(self._own, self._own + OWN_ITEMS)]
        if any(item.pending for item in items):
            return self._read_own_coils(unit, number)
        values = [self._dice.randrange(2) for _ in items]
        pdu = _words(15, self._own, OWN_ITEMS) + b"\1" + pack_bits(bytes(values))
        return Question(unit, pdu, _expect(pdu[:5]), _settle(items, [{value} for value in values]))

    def _unknown_function(self, unit: int, number: int) -> Question:
        data = self._dice.randbytes(self._dice.randint(2, 8))
        return Question(unit, bytes((OWN_FUNCTION,)) + data, _expect(bytes((OWN_FUNCTION, number)) + data))

    def _broadcast(self, unit: int, number: int) -> Question:
        """A register that this client's broadcasts write, and nothing else: a device may hear one or not."""
        address, value = self._own + OWN_ITEMS - 1, self._world.new_value()
        for each in NUMBERS.values():
            self._world.registers[each, address].possible.add(value)
        self._tally.broadcasts += 1
        return Question(0, _words(6, address, value), _expect(b""))


_SPANS = [(0, 1), (0, 4), (16, 4), (32, 4), (48, 4), (100, 2), (102, 2), (7, 1), (9, 1), (60, 40), (100, 100)]
_BIT_SPANS = [(0, 16), (16, 16), (40, 16), (3, 30), (100, 100)]
_MIX: dict[Callable[[Client, int, int], Question], int] = {
    Client._read_registers: 440,
    Client._read_bits: 120,
    Client._read_own: 120,
    Client._read_own_coils: 20,
    Client._read_others: 80,
    Client._write_register: 80,
    Client._write_registers: 50,
    Client._write_and_read: 20,
    Client._mask_register: 20,
    Client._write_coil: 20,
    Client._write_coils: 15,
    Client._unknown_function: 13,
    Client._broadcast: 2,
}
_KINDS = list(_MIX)
_WEIGHTS = [sum(list(_MIX.values())[: at + 1]) for at in range(len(_MIX))]


def _settle(items: Sequence[Item], values: Sequence[set[int]]) -> Callable[[str], None]:
    """Remember that `items` are being written; the result is to be told how that ended."""
    for item, value in zip(items, values, strict=True):
        item.writing(value)

    def settle(fate: str) -> None:
        for item, value in zip(items, values, strict=True):
            if fate == "not sent":
                item.pending = False
            else:
                item.written(value, sure=fate == "done")

    return settle


def _words(function: int, *words: int) -> bytes:
    return bytes((function,)) + b"".join(each.to_bytes(2) for each in words)


def _expect(response: bytes) -> Check:
    return lambda pdu: None if pdu == response else f"it is {response.hex(' ').upper()}"


def _not_possible(pdu: bytes, possible: Sequence[set[int]]) -> str | None:
    values = [int.from_bytes(pdu[at : at + 2]) for at in range(2, len(pdu), 2)]
    fits = len(values) == len(possible) and all(value in each for value, each in zip(values, possible, strict=True))
    return None if fits and pdu[1] == len(pdu) - 2 else f"it can be {[sorted(each)[:8] for each in possible]}"


@cache
def _static_words(number: int, area: Area, start: int, count: int) -> bytes:
    return b"".join(word(number, area, address).to_bytes(2) for address in range(start, start + count))


@cache
def _static_bits(number: int, area: Area, start: int, count: int) -> bytes:
    return pack_bits(bytes(bit(number, area, address) for address in range(start, start + count)))


async def play(transactions: int, share: float, seed: int, config: str = CONFIG) -> Tally:
    """One run; the running loop is in virtual time."""
    home = _House(config)
    async with keep_lines_open(home.gateway, home.events.append):
        await asyncio.sleep(1.0)
        world = World(home, seed, share, transactions)
        clients = [Client(world, number) for number in range(CLIENTS)]
        adapters = asyncio.create_task(world.pull_adapters())
        while not world.is_over:
            await asyncio.sleep(1.0)
            world.take_events()
        await adapters
        await asyncio.sleep(2 * PATIENCE)
        world.take_events()
    tally = world.tally
    for client in clients:
        for question in client.open.values():
            tally.complain(f"no answer to {question.unit}: {question.pdu.hex(' ').upper()}")
    if tally.slowest > PATIENCE:
        tally.complain(f"an answer took {tally.slowest:.3f} s")
    for line, of_gateway in zip(world.lines, status(home.gateway, world.loop.time()).lines, strict=True):
        tally.injected.update({fault.value: count for fault, count in line.injected.items()})
        tally.counts.update(asdict(of_gateway.counts) | {"unasked_bytes": of_gateway.unasked_bytes})
    tally.strangers = sum(stranger.asked for stranger in world.strangers)
    tally.virtual_seconds = world.loop.time()
    return tally


def run(transactions: int, share: float, seed: int) -> Tally:
    """One run, in a loop of its own."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(play(transactions, share, seed))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--transactions", type=int, default=1_000_000, help="on the lines, of all jobs together")
    parser.add_argument("--faults", default="20%", help="share of the transactions that meet one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes; each has a seed of its own")
    args = parser.parse_args()
    share = float(args.faults.removesuffix("%")) / 100
    tally, begin = Tally(), time.monotonic()
    with ProcessPoolExecutor(args.jobs) as pool:
        seeds = [args.seed * 1000 + job for job in range(args.jobs)]
        for part in pool.map(run, [args.transactions // args.jobs] * args.jobs, [share] * args.jobs, seeds):
            tally.add(part)
    elapsed = time.monotonic() - begin
    print(*tally.wrong[:20], sep="\n")
    print(tally)
    print(f"{elapsed:.0f} s, {tally.transactions / elapsed:.0f} transactions per second with {args.jobs} processes")
    print(LEFT_OUT)
    return 1 if tally.wrong_count else 0


if __name__ == "__main__":
    sys.exit(main())
