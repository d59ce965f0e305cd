"""A world of dated devices, and clients that ask them and judge every answer."""

import asyncio
import random
from collections import deque
from collections.abc import Coroutine, Iterable, Mapping, Sequence
from itertools import count, takewhile
from struct import iter_unpack
from typing import Any, Final

from gateway.devices.device import Device
from gateway.events import Event
from gateway.lines.last_reads import LastRead
from gateway.modbus import mbap
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.runtime.gateway import Gateway
from kit.gateway_bench import Client
from soak.dated import CELLS, DatedDevice, Write, Writes
from soak.judge import (
    A_MOMENT,
    NO_ANSWER,
    OF_GATEWAY,
    WRITE,
    WRITE_AND_READ,
    WRITE_SEVERAL,
    Reading,
    Served,
    trouble_with_exception,
    write_request,
)
from soak.tally import Tally

#: No request takes longer, in seconds.
PATIENCE: Final = 10.0
#: If nothing happens for so many seconds, nothing ever will: answers are missing.
_STANDSTILL: Final = 100.0
#: What is read: few different spans, so that clients ask the same, and the same shape, at the same time.
_SPANS: Final = [
    *((Area.HOLDING, first, items) for first, items in ((0, 4), (2, 4), (4, 4), (0, 8), (1, 1))),
    *((Area.INPUT, first, items) for first, items in ((0, 4), (2, 4), (4, 4), (0, 8))),
]
#: Of its writes to one unit a client remembers so many: more than it has requests under way.
_REMEMBERED: Final = 16
#: After an exception a client pauses so many times as long.
_LONGER: Final = 10
#: So many questions are the last one of their client.
_LAST: Final = 0.0005


class DatedWorld:
    """What all clients share: what units lead to, and the tally. Over after `goal` transactions."""

    def __init__(self, goal: int, seed: int) -> None:
        self.tally = Tally()
        self.loop = asyncio.get_running_loop()
        self.loop.set_exception_handler(lambda _, context: self.tally.complain(f"a defect: {context}"))
        self.dice = random.Random(seed)
        self.writes = Writes(self.tally.complain)
        self.served: dict[int, Served] = {}
        #: What passed lately between the gateway and each device.
        self.passed: dict[int, deque[str]] = {}
        self._goal = goal

    @property
    def is_over(self) -> bool:
        """Whether there have been enough transactions."""
        return self.tally.transactions >= self._goal

    def device(self, unit: int, number: int, timeout: float = 0.05) -> DatedDevice:
        """A device of this world."""
        return DatedDevice(unit, number=number, writes=self.writes, clock=self.loop.time, timeout=timeout)

    def units(self) -> Mapping[int, Served]:
        """What the units lead to at the moment."""
        return self.served

    def shown(self) -> Iterable[tuple[Device, DatedDevice | None]]:
        """The devices of the gateway whose values somebody may look at, and what each is; None: there is none."""
        return ()

    def _check_shown(self) -> None:
        """Compare what is shown as values, and not said to be outdated, with what the devices held."""
        for device, real in self.shown():
            written = self._written(real)
            for read in () if device.last_reads is None else device.last_reads.of(device.unit):
                if read.outdated:
                    continue
                self.tally.counts["values shown"] += 1
                trouble = "nobody answers there" if real is None else _trouble_with(read, real, written)
                if trouble:
                    what = f"{read.span.area} {read.span.start} of {device.name}: {read.response.hex(' ')}: {trouble}"
                    story = () if real is None else self.passed.get(real.number, ())
                    self.tally.complain("\n    ".join((f"at {self.loop.time():.6f} s shown as {what}", *story)))

    def _written(self, device: DatedDevice | None) -> list[Sequence[float]]:
        """When the cells of a device were written as clients know, for each unit that leads to it."""
        return [each.written_at for each in self.units().values() if each.device is device]

    async def run(self, events: list[Event], *beside: Coroutine[Any, Any, None]) -> Tally:
        """Run until it is over; all that is `beside` ends by itself then. What came of it."""
        tasks = [asyncio.ensure_future(each) for each in beside]
        last = changed_at = 0.0
        while not self.is_over and self.loop.time() < changed_at + _STANDSTILL:
            await asyncio.sleep(1.0)
            self.tally.take_events(events)
            self._check_shown()
            if self.tally.transactions > last:
                last, changed_at = self.tally.transactions, self.loop.time()
        self._goal = 0
        done, lost = await asyncio.wait(tasks, timeout=2 * PATIENCE)
        self.tally.take_events(events)
        for task in done:
            task.result()
        for task in lost:
            self.tally.complain(f"an answer is missing: {task!r}")
        if self.tally.slowest > PATIENCE:
            self.tally.complain(f"an answer took {self.tally.slowest:.3f} s")
        self.tally.virtual_seconds = self.loop.time()
        return self.tally


def _trouble_with(read: LastRead, device: DatedDevice, written: Iterable[Sequence[float]]) -> str | None:
    """Say what is wrong with a response: it was held since it was asked for, and since the last confirmed write."""
    first, registers = read.span.start, [each for (each,) in iter_unpack(">H", read.response[2:])]
    since, until = read.asked_at, read.asked_at + PATIENCE
    if read.span.area is Area.HOLDING:
        since = max([since, *(at[cell] for at in written for cell in range(first, read.span.end))])
        until = max(since, until)
    return device.trouble(read.span.area, first, registers, since - A_MOMENT, until)


async def keep_asking(
    world: DatedWorld,
    gateway: Gateway,
    number: int,
    *,
    at_once: int = 2,
    writes: float = 0.2,
    pause: float = 0.02,
    kind: "type[JudgingClient] | None" = None,
) -> None:
    """Ask until the world is over, so much `at_once`, with pauses of up to so many seconds. Who leaves comes again."""
    for visit in count(1):
        client = (kind or JudgingClient)(world, gateway, f"10.0.0.{number}:{visit}", writes)
        await asyncio.gather(*(client.ask_until_it_leaves(pause) for _ in range(at_once)))
        if world.is_over:
            break


class JudgingClient(Client):
    """A connection on which several requests may be under way; this share of them are `writes`."""

    def __init__(
        self,
        world: DatedWorld,
        gateway: Gateway,
        name: str,
        writes: float,
        *,
        host: str = "127.0.0.1",
        listener: int = 0,
    ) -> None:
        super().__init__(gateway, name, host=host, listener=listener)
        self._world = world
        self._tally = world.tally
        self._dice = random.Random(world.dice.random())
        self._writes = writes
        self._order = count()
        self._own: dict[int, deque[Write]] = {}
        #: Requests under way: what was asked, and where the answer goes; nothing when the client has left.
        self._open: dict[int, tuple[object, asyncio.Future[bytes]]] = {}

    async def ask_until_it_leaves(self, pause: float) -> None:
        """Ask, and judge the answer, again and again."""
        while not self._world.is_over and not self.session.gone:
            is_data = await self._ask_something()
            if self._dice.random() < _LAST:
                self._leave()
            await asyncio.sleep(self._dice.uniform(0.0, pause if is_data else _LONGER * pause))

    async def _ask_something(self) -> bool:
        """Ask something, and judge the answer; whether it was data."""
        unit, served = self._dice.choice(list(self._world.units().items()))
        is_write = served.device is not None and self._dice.random() < self._writes
        return await (self._write(unit, served, served.device) if is_write else self._read(unit, served))

    def _leave(self) -> None:
        self.session.closed()
        self._tally.abandoned += len(self._open)
        for _, answer in self._open.values():
            answer.set_result(b"")
        self._open.clear()

    async def _read(self, unit: int, served: Served) -> bool:
        """Read; whether data has come."""
        span = self._dice.choice(_SPANS)
        reading = Reading(served, *span, next(self._order), self._loop.time(), served.written_at[:])
        response = await self._asks(unit, served, reading.pdu)
        if not response:
            return False
        trouble = reading.trouble(response, self._own.get(unit, ()), self._loop.time())
        return self._judged("read", served, unit, reading.pdu, response, trouble)

    async def _write(self, unit: int, served: Served, device: DatedDevice) -> bool:
        """Write; whether that was acknowledged."""
        items = self._dice.randint(1, 3)
        first = self._dice.randrange(CELLS + 1 - items)
        function = self._dice.choice((WRITE, WRITE_SEVERAL) if items == 1 else (WRITE_SEVERAL, WRITE_AND_READ))
        write = self._world.writes.ask(device, first, items, next(self._order))
        self._own.setdefault(unit, deque(maxlen=_REMEMBERED)).append(write)
        pdu, right = write_request(function, first, write.values)
        response = await self._asks(unit, served, pdu)
        if not response:
            return False
        trouble = None
        if response == right:
            write.is_acknowledged = True
            served.acknowledged(write)
            trouble = None if write.done_at is not None else "the device has not done that"
        elif response[0] != pdu[0] | EXCEPTION_BIT:
            trouble = f"it is {right.hex(' ').upper()}"
        elif response[1] != NO_ANSWER:
            write.is_refused = True
            trouble = trouble_with_exception(response[1], of_device=True)
            if write.done_at is not None:
                trouble = f"the device has done that at {write.done_at:.6f} s"
        return self._judged("write", served, unit, pdu, response, trouble)

    def _judged(self, kind: str, served: Served, unit: int, pdu: bytes, response: bytes, trouble: str | None) -> bool:
        """Count the outcome; whether it is data."""
        row = kind if served.stale is None else f"{kind} through a mirror"
        outcome = "right data"
        if response[0] & EXCEPTION_BIT:
            outcome = f"{response[1]:02X}" if response[1] in OF_GATEWAY else "device's exception"
        self._tally.outcomes[row, "WRONG" if trouble else outcome] += 1
        if trouble:
            story = [] if served.device is None else self._world.passed.get(served.device.number, ())
            self._tally.complain(
                f"at {self._loop.time():.6f} s {self.session.caller.client} asked {unit}: "
                f"{pdu.hex(' ').upper()} and got "
                + "\n    ".join((f"{response.hex(' ').upper()}: {trouble} ({row})", *story))
            )
        return not response[0] & EXCEPTION_BIT

    # --- the connection ---

    async def _asks(self, unit: int, served: object, pdu: bytes) -> bytes:
        """The response to a request; nothing if the client leaves before. `served` is what the unit leads to."""
        self._tally.questions += 1
        self._transaction = self._transaction + 1 & 0xFFFF
        answer = self._loop.create_future()
        self._open[self._transaction] = served, answer
        asked_at = self._loop.time()
        adu = mbap.encode(self._transaction, unit, pdu)
        self.session.room()[: len(adu)] = adu
        self.session.received(len(adu), asked_at)
        response = await answer
        self._tally.slowest = max(self._tally.slowest, self._loop.time() - asked_at)
        if response and response[0] != unit:
            self._tally.complain(f"{self.session.caller.client} asked {unit}, and {response[0]} answered")
        return response[1:]

    def send(self, data: bytes) -> None:
        while data:
            transaction, size = int.from_bytes(data[:2]), 6 + int.from_bytes(data[4:6])
            self._answered(transaction, data[6:size])
            data = data[size:]

    def _answered(self, transaction: int, response: bytes) -> None:
        if transaction not in self._open:
            self._tally.complain(f"{self.session.caller.client}: an answer to {transaction}, which is not open")
            return
        served, answer = self._open[transaction]
        earlier = takewhile(lambda each: each != transaction, self._open)
        if not response[1] & EXCEPTION_BIT and any(self._open[each][0] is served for each in earlier):
            self._tally.complain(
                f"{self.session.caller.client}: {response.hex(' ')} came before the answer to an earlier request"
            )
        del self._open[transaction]
        answer.set_result(response)

    def reject(self, reason: str) -> None:
        self._tally.complain(f"{self.session.caller.client} was rejected: {reason}")
