"""Lines full of faults: RTU and ASCII, real, virtual, with and without echo, and a device server that stalls.

Devices whose values say whose they are, clients that read and write without pause, another client on each line,
adapters that cut and join what they hear, adapters that are pulled, clients that leave. Every answer is compared with
what can be true at that moment.
"""

import asyncio
import random
from collections import deque
from collections.abc import Callable
from dataclasses import asdict
from math import inf
from typing import Final

from gateway.lines.transaction import Transaction
from gateway.listeners.sessions import session
from gateway.listeners.sessions.mbap import MbapSession
from gateway.modbus import mbap
from gateway.modbus.codes import Area
from gateway.modbus.frame import Frame
from gateway.ports.port import OpenPort, Port, PortUser, SerialSettings
from gateway.request import Caller
from kit.faulty import Fault, FaultyDevice, FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from kit.memory import MemoryLine
from kit.other_client import Adapter, OtherClient
from kit.statuses import status
from soak.kinds_of_lines import CONFIG, LINES, NUMBERS, SLOW, UNITS, LineKind
from soak.questions import CLIENTS, Question, Questions, Values
from soak.stalling_server import StallingServer
from soak.tally import Tally

#: Another client asks on each line, on average after so many seconds of quiet.
OTHER_CLIENT_PAUSE: Final = 0.3
#: No request takes longer in virtual seconds: `max_wait`, then twice the longest limit and late window of a line.
PATIENCE: Final = 9.0

#: What the gateway itself may answer to a request that it has not sent; 0B may follow on one that was.
NOT_SENT: Final = frozenset({0x06, 0x0A})
NO_ANSWER: Final = 0x0B

#: What devices behind a server that stalls do; others are left out, because nobody could detect them there.
BEHIND_A_SERVER: Final = (
    *(Fault.EXCEPTION, Fault.LATE, Fault.LATE_EXCEPTION, Fault.CUT, Fault.FLIPPED, Fault.NOISE_BEFORE),
    *(Fault.NOISE_BEHIND, Fault.NOISE_BETWEEN, Fault.HOLES, Fault.SILENT),
)

#: How often an adapter was pulled, and a device server connected to: what is under way from before that is lost.
Connection = tuple[int, int]


class _RealLine(MemoryLine):
    """A line behind a serial port, where no answer comes before its request has left."""

    async def open_port(self, user: PortUser) -> Port:
        port = await super().open_port(user)
        port.is_virtual = False
        return port


class _Bench(GatewayBench):
    def _open(self, settings: SerialSettings) -> OpenPort:
        kind = next(line for line in LINES if settings.port in (line.port, f"/dev/{line.name}"))
        kind_of_line = StallingServer if kind.port else _RealLine if kind.real else MemoryLine
        return self.lines.setdefault(kind.name, kind_of_line(settings.port, settings.latency)).open_port


class World:
    """Everything that the clients share: devices as they can be, and the tally."""

    def __init__(self, bench: GatewayBench, seed: int, share: float, goal: int) -> None:
        self.bench = bench
        self.loop = asyncio.get_running_loop()
        self.tally = Tally()
        self.goal = goal
        self.dice = random.Random(seed)
        self.values = Values()
        self.clients: dict[str, Client] = {}
        self.lines: list[FaultyLine] = []
        self.other_clients: list[OtherClient] = []
        self.adapters: dict[str, Adapter] = {}
        #: What passed on each line lately: when, `>>` sent or `<<` received, and the fault that was injected.
        self.passed: dict[str, deque[tuple[float, str, bytes, str]]] = {name: deque(maxlen=24) for name in bench.lines}
        self._pulls: dict[str, int] = dict.fromkeys(bench.lines, 0)
        for at, kind in enumerate(LINES):
            self._attach(at, kind, seed, share)

    @property
    def is_over(self) -> bool:
        """Whether there have been enough transactions."""
        return self.tally.transactions >= self.goal

    def _attach(self, at: int, kind: LineKind, seed: int, share: float) -> None:
        devices = [
            FaultyDevice(
                unit,
                number=NUMBERS[10 * at + unit],
                timeout=kind.timeout * (SLOW if unit > 6 else 1),
                sleeps_after=kind.wake,
            )
            for unit in UNITS
        ]
        faulty = FaultyLine(
            kind.timing,
            *devices,
            share=share,
            seed=100 * seed + at,
            faults=dict.fromkeys(BEHIND_A_SERVER, 1.0) if kind.port else None,
            echo=kind.echo,
            late_window=kind.late_window,
        )
        self.lines.append(faulty)
        line, name, passed = self.bench.lines[kind.name], kind.name, self.passed[kind.name]

        deliver = self._plug_in(at, kind, faulty, seed)

        def answer(data: bytes) -> None:
            line.written.clear()
            self.tally.transactions += 1
            now = self.loop.time()
            answers = faulty.received(data, now)
            faulty.heard_at = max(faulty.heard_at, now + len(data) * kind.timing.character)
            passed.append((now, ">>", data, faulty.last.fault))
            if isinstance(line, StallingServer):
                answers = line.asked(answers, now)
            for delay, response in answers:
                self.loop.call_later(delay, deliver, self._connection(name), response)

        def observe(transaction: Transaction, response: Frame | None, now: float) -> None:
            tries = 1 + transaction.retries + (kind.wake < inf)
            sent = faulty.encode(transaction.unit, transaction.asked.data)
            codes = {injection.code for data, injection in [each for each in faulty.latest if each[0] == sent][-tries:]}
            for request in transaction.requests:
                client = self.clients.get(request.caller.client)
                if client is not None and (question := client.open.get(request.transaction)) is not None:
                    question.fault, question.codes, question.tries = faulty.last.fault, codes, tries

        line.on_write = answer
        self.bench.gateway.lines[at].driver.line.observer = observe

    def _plug_in(self, at: int, kind: LineKind, faulty: FaultyLine, seed: int) -> Callable[[Connection, bytes], None]:
        """Let a line be heard through its adapter, another client on it included; for what comes while it is there."""
        line, name = self.bench.lines[kind.name], kind.name

        def hand_over(data: bytes) -> None:
            data = faulty.chance.spoil(data)
            self.passed[name].append((self.loop.time(), "<<", data, ""))
            line.deliver(data)

        adapter = self.adapters[name] = Adapter(self.loop.call_later, hand_over, seed=100 * seed + at)

        def deliver(connection: Connection, data: bytes) -> None:
            if connection == self._connection(name):
                faulty.heard_at = self.loop.time()
                faulty.chance.sent(data)
                adapter.take(data, at_once=faulty.heard_at < faulty.spurious_until)

        if isinstance(line, StallingServer):  # what is heard of another client shows that it does not stall
            line.dice, line.on_open, line.share = random.Random(100 * seed + at), adapter.drop, kind.stalls
            return deliver

        other_client = OtherClient(faulty, seed=100 * seed + at)
        self.other_clients.append(other_client)

        def let_other_client_ask() -> None:
            now = self.loop.time()
            wait = 0.1 if self._pulls[name] % 2 else other_client.may_ask_at - now
            if self.is_over:
                return
            if wait > 0.0:
                self.loop.call_later(wait + self.dice.uniform(0.0, 0.001), let_other_client_ask)
                return
            for delay, data in other_client.asks(now):
                self.loop.call_later(delay, deliver, self._connection(name), data)
            self.loop.call_later(self.dice.expovariate(1 / OTHER_CLIENT_PAUSE), let_other_client_ask)

        self.loop.call_later(self.dice.uniform(0.0, OTHER_CLIENT_PAUSE), let_other_client_ask)
        return deliver

    def _connection(self, name: str) -> Connection:
        line = self.bench.lines[name]
        return self._pulls[name], line.openings if isinstance(line, StallingServer) else 0

    async def pull_adapters(self) -> None:
        """Now and then one line has no adapter for a while; what was under way to it is lost."""
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(5.0, 40.0))
            name = self.dice.choice(list(self.bench.lines))
            self._pulls[name] += 1
            self.adapters[name].drop()
            self.bench.lines[name].pull()
            await asyncio.sleep(self.dice.uniform(0.001, 2.0))
            self.bench.lines[name].plug()
            await asyncio.sleep(2.0)  # until it is open again
            self._pulls[name] += 1

    def check_values(self) -> None:
        """Compare what is shown as the values of all devices with what they hold."""
        devices = {each.settings.known_as: each for line in self.bench.gateway.lines for each in line.all_devices}
        for unit, number in NUMBERS.items():
            for read in devices[unit].last_reads.of(devices[unit].unit):
                if read.outdated or read.span.area not in (Area.HOLDING, Area.INPUT):
                    continue
                self.tally.counts["values shown"] += 1
                for place, address in enumerate(range(read.span.start, read.span.end)):
                    value = int.from_bytes(read.response[2 + 2 * place :][:2])
                    if not self.values.may_hold(number, read.span.area, address, value):
                        where = f"{read.span.area} {address} of {unit}"
                        self.tally.complain(f"{value:04X} is shown for {where}\n" + self.story(unit))

    def story(self, unit: int) -> str:
        """What passed lately on the line of a unit."""
        kind = LINES[unit // 10]
        show = repr if kind.timing.mode == "ascii" else lambda data: data.hex(" ").upper()
        return "\n".join(
            f"    {at:.6f} {kind.name} {way} {show(data)} {fault}" for at, way, data, fault in self.passed[kind.name]
        )


class Client(session.Connection):
    """A connection that always has some requests under way, and checks every answer."""

    address = "127.0.0.1"

    def __init__(self, world: World, number: int) -> None:
        self.open: dict[int, Question] = {}
        self._world = world
        self._tally = world.tally
        self._loop = world.loop
        self._number = number
        self._dice = random.Random(world.dice.random())
        self.questions = Questions(world.values, number, self._dice)
        self._transaction = 0
        self._connections = 0
        self._connect()

    def _connect(self) -> None:
        self._connections += 1
        listener = self._world.bench.gateway.listeners[0]
        name = f"10.0.0.{self._number}:{self._connections}"
        self._session = MbapSession(
            Caller(name, "127.0.0.1", "127.0.0.1"),
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
        del self._world.clients[self._session.caller.client]
        for question in self.open.values():
            self._tally.abandoned += 1
            if question.settle is not None:
                question.settle("unknown")
        self.open.clear()
        self._connect()

    # --- what the session sees ---

    def receive(self, room: memoryview) -> int:
        return 0

    def send(self, data: bytes) -> None:
        while data:
            transaction, size = int.from_bytes(data[:2]), 6 + int.from_bytes(data[4:6])
            self._answered(transaction, data[6], data[7:size])
            data = data[size:]

    def time(self) -> float:
        return self._loop.time()

    def pause(self) -> None:
        pass

    def resume(self) -> None:
        session = self._session
        self._loop.call_soon(lambda: session.proceed(self._loop.time()))

    def release_after(self, seconds: float) -> None:
        self._loop.call_later(seconds, self._session.release)

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
        question = self.questions.think_of_one()
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


async def play(transactions: int, share: float, seed: int, config: str = CONFIG) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = _Bench(config)
    async with keep_lines_open(bench.running):
        await asyncio.sleep(1.0)
        world = World(bench, seed, share, transactions)
        clients = [Client(world, number) for number in range(CLIENTS)]
        adapters = asyncio.create_task(world.pull_adapters())
        while not world.is_over:
            await asyncio.sleep(1.0)
            world.tally.take_events(bench.events)
            world.check_values()
        await adapters
        await asyncio.sleep(2 * PATIENCE)
        world.tally.take_events(bench.events)
    tally = world.tally
    for client in clients:
        for question in client.open.values():
            tally.complain(f"no answer to {question.unit}: {question.pdu.hex(' ').upper()}")
    if tally.slowest > PATIENCE:
        tally.complain(f"an answer took {tally.slowest:.3f} s")
    for line, of_gateway in zip(world.lines, status(bench.running).lines, strict=True):
        tally.injected.update({fault.value: count for fault, count in line.injected.items()})
        tally.counts.update(asdict(of_gateway.counts) | {"unasked_bytes": of_gateway.unasked_bytes})
    tally.broadcasts = sum(client.questions.broadcasts for client in clients)
    tally.counts["stalls"] = sum(line.stalls for line in bench.lines.values() if isinstance(line, StallingServer))
    tally.counts["openings"] = sum(line.openings for line in bench.lines.values() if isinstance(line, StallingServer))
    tally.other_clients = sum(other_client.asked for other_client in world.other_clients)
    tally.virtual_seconds = world.loop.time()
    return tally
