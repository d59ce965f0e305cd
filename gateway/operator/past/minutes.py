"""What a line did in each minute of the last hour, out of the ring, which knows more than the history does."""

import asyncio
from collections import Counter
from collections.abc import Sequence
from time import sleep
from typing import Final, NamedTuple

from gateway.clock.slices import turn
from gateway.clock.threads import ThreadPerCall
from gateway.lines.counts import UNSENT
from gateway.operator.operator import Operator
from gateway.timing.history import LineUse, Past, Slot, UnitUse
from gateway.trace.records import Incident, Record, Refused, Sent

#: The length of a slot in seconds, and how many make the hour.
MINUTE: Final = 60
MINUTES: Final = 60
#: The most records that are gone through: with more, the history has to do.
MOST_RECORDS: Final = 100_000
#: How old what is shown may be, in seconds: any number of readers costs no more than one.
KEPT: Final = 8.0
#: After so many records the thread rests for so long, in seconds.
_SLICE: Final = 64
_PAUSE: Final = 0.001


class LastHour(NamedTuple):
    """The minutes of the last hour, and the requests of each client in them by the number of the minute."""

    past: Past
    clients: dict[int, Counter[str]]


class _Kept:
    """The last hours that somebody has looked at, by line, each with when that was."""

    def __init__(self) -> None:
        self.hours: dict[str, tuple[float, LastHour | None]] = {}
        self.one_at_a_time = asyncio.Lock()


async def last_hour(operator: Operator, line: str) -> LastHour | None:
    """Return what a line did in the minutes of the last hour, as it was at most KEPT seconds ago.

    None if the ring does not reach back so far. Records are added up in a thread, which leaves the lines their time.
    """
    kept, loop = operator.kept(_Kept), asyncio.get_running_loop()
    async with kept.one_at_a_time:
        at, hour = kept.hours.get(line, (-KEPT, None))
        if loop.time() - at >= KEPT:
            hour = await _look(operator, line)
            kept.hours = {name: one for name, one in kept.hours.items() if loop.time() - one[0] < KEPT}
            kept.hours[line] = loop.time(), hour
        return hour


async def _look(operator: Operator, line: str) -> LastHour | None:
    running, loop = operator.running, asyncio.get_running_loop()
    ring, now = running.ring, loop.time()
    offset = operator.clock() - now
    last = int((now + offset) // MINUTE)
    first = last - MINUTES + 1
    begin = max(first * MINUTE - offset, running.started)
    number = ring.number_at(begin)
    has_lost_some = ring.first > 0 and (ring.begins_at is None or ring.begins_at > begin)
    if not ring.is_on or has_lost_some or ring.added - number > MOST_RECORDS:
        return None
    found: list[Record] = []
    while number < ring.added:
        records = ring.after(number)
        number = max(number, ring.first) + len(records)
        found += (record for record in records if record.line == line)
        await turn()
    slots = _empty(first, line, begin + offset, now + offset)
    return await loop.run_in_executor(ThreadPerCall("last hour"), _added_up, first, slots, found, offset)


def _added_up(first: int, slots: dict[int, Slot], records: Sequence[Record], offset: float) -> LastHour:
    """Add up the records of a line, with pauses for the lines."""
    clients: dict[int, Counter[str]] = {}
    for count, record in enumerate(records):
        if not count % _SLICE:
            sleep(_PAUSE)
        minute = int((record.at + offset) // MINUTE)
        slot = slots.get(minute)
        if slot is not None:
            _add(slot, record)
            if isinstance(record, Sent):
                clients.setdefault(minute, Counter())[record.client] += 1
    return LastHour(Past(first, [slots.get(each) for each in range(first, first + MINUTES)], MINUTE), clients)


def _empty(first: int, line: str, begin: float, end: float) -> dict[int, Slot]:
    """Make the slots of the minutes in which the gateway ran, each with the seconds that it did."""
    slots = {}
    for number in range(first, first + MINUTES):
        seconds = min(end, (number + 1) * MINUTE) - max(begin, number * MINUTE)
        if seconds > 0:
            slots[number] = slot = Slot(number)
            slot.lines[line] = LineUse(seconds=seconds)
    return slots


def _add(slot: Slot, record: Record) -> None:
    if isinstance(record, Sent):
        error = record.error if isinstance(record, Incident) else None
        is_lost = error is not None or (isinstance(record, Incident) and record.sent_again)
        sent = LineUse(busy=record.at - record.sent_at, sent=1, failed=int(is_lost))
        slot.add({record.line: sent}, {record.name: _use(record)} if record.name else {})
    elif isinstance(record, Refused) and record.name and record.result in UNSENT:
        slot.add({}, {record.name: UnitUse(requests=1, unsent=1)})


def _use(record: Sent) -> UnitUse:
    """Count a request that was sent. One that is sent again counts when it has ended."""
    if record.result in ("ok", "exception"):
        answer = max(0.0, record.at - record.ends_at)
        share = answer / record.limit if record.limit else 0.0
        return UnitUse(
            requests=1, exceptions=int(record.result == "exception"), responses=1, answer=answer, share=share
        )
    if record.result == "not_answered":  # a broadcast
        return UnitUse(requests=1)
    if isinstance(record, Incident) and record.sent_again:
        return UnitUse()
    is_timeout = record.result == "timeout"
    return UnitUse(requests=1, timeouts=int(is_timeout), failed=int(not is_timeout))
