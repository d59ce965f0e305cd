"""The ring for readers over HTTP, as a stream of facts or a capture file, without the values that they may not read."""

import asyncio
import json
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

from gateway.clock.slices import turn
from gateway.clock.threads import ThreadPerCall
from gateway.errors import WrongQuestion
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.functions import READING_FUNCTIONS
from gateway.operator.operations.answers.trace import Fact, TracePage
from gateway.operator.operations.asked import Traced
from gateway.operator.operator import Operator
from gateway.operator.trace.capture import description, packets
from gateway.operator.trace.facts import Clock, clocks, fact
from gateway.operator.trace.meanings import Points, points_of
from gateway.operator.trace.sampling import Sample
from gateway.operator.trace.selection import lines, wanted
from gateway.operator.trace.trace import page
from gateway.operator.trace.unit_names import UnitNames
from gateway.routing.access import READING, Right
from gateway.runtime.running import Running
from gateway.trace.pcapng import Writer
from gateway.trace.records import FAILURES, Heard, PortChanged, Record, Sent
from gateway.trace.ring import STEP, Ring
from gateway.version import __version__

#: Seconds until the next look for new records, until the next step through old ones, and between `clock` messages.
_STEP: Final = 0.1
_MORE: Final = 0.01
_CLOCK_EVERY: Final = 1.0
#: How many texts are kept for other readers: those of a few steps at full rate.
_MOST_TEXTS: Final = 1024
#: The PDUs and bytes in facts: None where a reader may not see them.
_VALUES: Final = ("request", "response", "heard", "frame")

#: At most this many records are searched for the latest ones.
MOST_LOOKED_AT: Final = 20_000

MaySee = Callable[[Record], bool]


class Texts:
    """Records as JSON, made once for all readers at about the same time."""

    def __init__(self) -> None:
        #: By the `id` of the record, which is kept with its text so that no other record can have it.
        self._texts: OrderedDict[tuple[int, bool], tuple[Record, str]] = OrderedDict()

    def of(self, record: Record, clock: Clock, names: UnitNames, points: Points | None = None) -> str:
        """Return the text of a record with its values, and with what they mean if there are `points`."""
        key = id(record), points is not None
        found = self._texts.get(key)
        if found is not None:
            return found[1]
        told = fact(record, clock, names)
        text = json.dumps(told if points is None else points.beside(told), ensure_ascii=False)
        self._texts[key] = (record, text)
        if len(self._texts) > _MOST_TEXTS:
            self._texts.popitem(last=False)
        return text


class TraceReader:
    """The trace for one reader at the address `host`: facts as JSON, and the time each second.

    With `per_second`, other records are left out, and the time comes with their number. `is_lost` is set when the ring,
    or the line or unit that was asked for, no longer exists.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """

    def __init__(
        self, operator: Operator, asked: Traced, host: str, texts: Texts, per_second: int | None = None
    ) -> None:
        self.is_lost = False
        self._operator = operator
        self._running = operator.running
        self._asked = asked
        self._sample = None if per_second is None else Sample(per_second, asyncio.get_running_loop().time())
        self._host = host
        self._texts = texts
        self._told_at = 0.0
        self._after = 0
        self._is_up_to_date = False
        self._first = self._fetch(asked)

    async def next(self, patience: float) -> Sequence[str]:
        """Return what has happened since the last call; empty if nothing happens within `patience` seconds."""
        loop = asyncio.get_running_loop()
        until = loop.time() + patience
        found, self._first = self._first, []
        while not found and loop.time() < until:
            await asyncio.sleep(_STEP if self._is_up_to_date else _MORE)
            try:
                found = self._fetch(replace(self._asked, after=self._after))
            except WrongQuestion:
                self.is_lost = True
                return []
        return found

    def _fetch(self, asked: Traced) -> list[str]:
        clock = clocks()
        may_see = what_is_seen(self._running, self._host)
        points = points_of(self._operator) if asked.points else None

        def tell(record: Record, clock: Clock, names: UnitNames) -> str:
            if may_see(record):
                return self._texts.of(record, clock, names, points)
            return json.dumps(without_values(fact(record, clock, names)), ensure_ascii=False)

        found = page(self._running, asked, clock, tell, self._choose)
        self._after, self._is_up_to_date = found.next, found.is_all
        told = list(found.facts)
        if found.missed and asked.after is not None:
            told.insert(0, json.dumps({"kind": "missed", "time": round(clock[1], 6), "count": found.missed}))
        if found.is_all and clock[0] - self._told_at >= _CLOCK_EVERY:
            self._told_at = clock[0]
            told.append(json.dumps({"kind": "clock", "time": round(clock[1], 6), **self._left_out()}))
        return told

    def _choose(self, records: Sequence[Record]) -> Sequence[Record]:
        return records if self._sample is None else self._sample.of(records, asyncio.get_running_loop().time())

    def _left_out(self) -> Mapping[str, int]:
        return {} if self._sample is None else {"left_out": self._sample.taken()}


async def latest(running: Running, asked: Traced, host: str, most: int) -> Sequence[Fact]:
    """List the last facts, newest first and `most` at most, as a reader at the address `host` may see them.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """
    clock, is_wanted, may_see = clocks(), wanted(running, asked), what_is_seen(running, host)
    names = UnitNames(running.gateway)
    found: list[Fact] = []
    for records in _newest_first(running.ring, only_failures=asked.result in FAILURES):
        for record in records:
            if is_wanted(record) and len(found) < most:
                told = fact(record, clock, names)
                found.append(told if may_see(record) else without_values(told))
        if len(found) >= most:
            break
        await turn()
    return found


def _newest_first(ring: Ring, *, only_failures: bool) -> Iterator[Sequence[Record]]:
    """Yield the records in the ring, newest first, some at a time; records may be added meanwhile."""
    if only_failures:
        failures = list(ring.failures())
        yield from (failures[at : at + STEP] for at in range(0, len(failures), STEP))
        return
    number = ring.added
    last = number - MOST_LOOKED_AT
    while number > max(ring.first, last):
        begin = max(ring.first, number - STEP)
        yield ring.after(begin, number - begin)[::-1]
        number = begin


async def capture(running: Running, asked: Traced, host: str) -> AsyncIterator[bytes]:
    """Yield the parts of a capture file of what is `asked` for, each with the rights of its moment.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """
    loop, told = asyncio.get_running_loop(), lines(running.gateway)
    modes = {line.name: line.mode for line in told}
    descriptions = {line.name: description(line) for line in told}
    writer = Writer(f"modbus-gateway {__version__}")

    def fetch(asked: Traced) -> TracePage:
        may_see = what_is_seen(running, host)

        def tell(record: Record, clock: Clock, names: UnitNames) -> Fact | None:
            return fact(record, clock, names) if may_see(record) else None

        return page(running, asked, clocks(), tell)

    def written(facts: Sequence[Fact | None]) -> bytes:
        frames = (packet for each in facts if each is not None for packet in packets(each, modes))
        return b"".join(writer.interface(each.line, descriptions[each.line]) + writer.packet(each) for each in frames)

    end = running.ring.added
    found = fetch(asked)
    yield writer.head()
    while True:
        yield await loop.run_in_executor(ThreadPerCall("web capture"), written, found.facts)
        if found.next >= end:
            return
        found = fetch(replace(asked, after=found.next))


def may_see_all(running: Running, host: str) -> bool:
    """Return whether a reader at this address may read every unit over HTTP."""
    return running.routers.web.rights.reads_all(host)


def what_is_seen(running: Running, host: str) -> MaySee:
    """Make the test whether a reader at this address may see the values of a record: those that it may read over HTTP.

    Written values, frames of unknown origin and units that are reached only by a listener for their line or upstream
    need the right to read everything; what came instead of an answer, the right to read every address.
    """
    if may_see_all(running, host):
        return lambda _: True
    gateway, rights = running.gateway, running.routers.web.rights
    names = UnitNames(gateway)
    units = {name: unit for unit, name in names.shared.items()}
    places = {(owner.name, device.unit): device.name for owner in gateway.owners for device in owner.devices.values()}

    def is_seen(record: Record) -> bool:
        if isinstance(record, PortChanged):
            return True
        if isinstance(record, Heard):
            name = "" if record.kind == "noise" else places.get((record.line, record.frame[0]), "")
            return name in units and _may_read_any(rights.everywhere(host, units[name]), record.frame[1:])
        name, request = record.name if isinstance(record, Sent) else names.of(record), getattr(record, "request", b"")
        if name not in units:
            return False
        if request and request[0] in READING_FUNCTIONS and not getattr(record, "heard", b""):
            return rights.permits(host, units[name], request)
        return _may_read_any(rights.everywhere(host, units[name]), request)

    return is_seen


def without_values(told: Fact) -> Fact:
    """Return a fact without its values."""
    return {name: None if name in _VALUES else value for name, value in told.items()}


def _may_read_any(right: Right, pdu: bytes) -> bool:
    """Return whether a right to every address includes the values in a PDU, which may be a request or a response."""
    function = pdu[0] & ~EXCEPTION_BIT if pdu else 0
    return function in right if function in READING_FUNCTIONS else right >= READING
