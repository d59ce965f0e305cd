"""The registers of a device that passed last, out of the trace: for a device of which no point is known."""

import asyncio
from collections.abc import Sequence
from typing import Final, NamedTuple

from gateway.clock.slices import turn
from gateway.errors import RequestError
from gateway.modbus.pdu import Span, parse_sent
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import device_of
from gateway.registers.items import items_read
from gateway.trace.records import Sent
from gateway.trace.ring import STEP

#: At most so many records are searched, newest first, and so many different reads are shown.
MOST_RECORDS: Final = 64 * STEP
MOST_READS: Final = 8


class Passed(NamedTuple):
    """What a client's read of `span` was answered with: its items, `age` seconds ago."""

    span: Span
    items: bytes
    client: str
    age: float


async def passed(operator: Operator, unit: UnitPicture, asker: Asker) -> Sequence[Passed]:
    """Find the last different reads of a device that the asker may read too, newest first."""
    device, ring, now = device_of(operator.gateway, unit.key), operator.running.ring, asyncio.get_running_loop().time()
    if device is None:
        return ()
    of_device = device.line_name, device.name, device.unit
    rights, found = operator.router(asker.door).rights, dict[bytes, Passed]()
    last, oldest = ring.added, max(ring.first, ring.added - MOST_RECORDS)
    while last > oldest and len(found) < MOST_READS:
        first = max(oldest, last - STEP)
        for record in reversed(ring.after(first, last - first)):
            if not isinstance(record, Sent) or (record.line, record.name, record.address) != of_device:
                continue
            read = None if record.request in found or len(found) == MOST_READS else _read(record, now)
            if read is not None and rights.permits(asker.host, unit.key, record.request):
                found[record.request] = read
        last = first
        await turn()
    return list(found.values())


def _read(record: Sent, now: float) -> Passed | None:
    """Take the items out of an answered read; None if it was none."""
    try:
        span = parse_sent(record.request).read
        if span is None or record.response is None or record.result != "ok":
            return None
        return Passed(span, items_read(span, record.response), record.client, now - record.sent_at)
    except (RequestError, ValueError):
        return None
