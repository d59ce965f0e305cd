"""What clients of dated devices may be answered, by what a device held, and when.

- Data that was read from a device was held by it between question and answer; data from a mirror, within `stale` before
  the answer.
- It shows the client's earlier writes to the same unit that were acknowledged, and none that it asked for later. A
  mirror shows what anybody has written through it to these addresses, if it was acknowledged before the question.
- A write is done by its own device, once: before it is acknowledged, and never after 06, 0A or an exception of the
  device.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, starmap
from math import inf
from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT, Area
from kit.faulty import EXCEPTION_CODES
from soak.dated import CELLS, DatedDevice, Write

#: What was done at the moment of a question may be on either side of it, in seconds.
A_MOMENT: Final = 1e-6
#: Exceptions of the gateway; after the first one the device may have acted.
NO_ANSWER: Final = 0x0B
OF_GATEWAY: Final = (NO_ANSWER, 0x06, 0x0A)
_READ: Final = {Area.HOLDING: 3, Area.INPUT: 4}
WRITE, WRITE_SEVERAL, WRITE_AND_READ = 6, 16, 23


class Served:
    """What a unit leads to: a device, or nothing. The values of a mirror are `stale` seconds old at most.

    `parts` are the addresses at which a mirror's other polls begin: values of two polls may be of different times.
    """

    def __init__(self, device: DatedDevice | None, stale: float | None = None, parts: tuple[int, ...] = ()) -> None:
        self.device = device
        self.stale = stale
        self.parts = parts
        #: Of each cell, when the last write was done that is acknowledged.
        self.written_at = [-inf] * CELLS

    def acknowledged(self, write: Write) -> None:
        """A write is acknowledged that has been done."""
        for address in write.addresses:
            self.written_at[address] = max(self.written_at[address], write.done_at or -inf)


@dataclass(frozen=True)
class Reading:
    """A read that is under way, the `order`th request of its client; `written_at` is as it was then."""

    served: Served
    area: Area
    first: int
    items: int
    order: int
    asked_at: float
    written_at: Sequence[float]

    @property
    def pdu(self) -> bytes:
        """The request."""
        return words(_READ[self.area], self.first, self.items)

    def trouble(self, response: bytes, own: Sequence[Write], now: float) -> str | None:
        """Say what is wrong with an answer that has come now; `own` are the client's writes to the unit."""
        device, parts, size = self.served.device, self.served.parts, 2 * self.items
        if response[0] & EXCEPTION_BIT:
            return trouble_with_exception(response[1], of_device=self.served.stale is None)
        if device is None or response[:2] != bytes((_READ[self.area], size)) or len(response) != 2 + size:
            return "nobody answers that"
        registers = [int.from_bytes(response[at : at + 2]) for at in range(2, 2 + size, 2)]
        end = self.first + self.items
        for span in starmap(range, pairwise((self.first, *(at for at in parts if self.first < at < end), end))):
            part = registers[span.start - self.first : span.stop - self.first]
            trouble = device.trouble(self.area, span.start, part, *self._time(span, own, now))
            if trouble:
                return trouble
        return None

    def _time(self, span: range, own: Sequence[Write], now: float) -> tuple[float, float]:
        """From when to when these addresses may have held what was read."""
        stale = self.served.stale
        is_written = self.area is Area.HOLDING
        since = (self.asked_at if stale is None else now - stale) - A_MOMENT
        if stale is not None and is_written:
            since = max(since, *(self.written_at[each] for each in span))
        for write in own:
            if write.device is not self.served.device:
                continue  # the unit led to another device then
            if write.done_at is not None and write.order > self.order:
                now = min(now, write.done_at)
            elif write.is_acknowledged and (stale is None or (is_written and write.touches(span))):
                since = max(since, write.done_at or since)
        return since, now


def trouble_with_exception(code: int, *, of_device: bool) -> str | None:
    """Say what is wrong with an exception. If it cannot be one of the device, a mirror has answered."""
    return None if code in ((*OF_GATEWAY, *EXCEPTION_CODES) if of_device else (NO_ANSWER,)) else "nobody answers that"


def write_request(function: int, first: int, values: list[int]) -> tuple[bytes, bytes]:
    """A request to write registers, and the right response."""
    if function == WRITE:
        return (words(WRITE, first, *values),) * 2
    data = bytes((2 * len(values),)) + b"".join(each.to_bytes(2) for each in values)
    head = words(function, first, len(values))
    if function == WRITE_SEVERAL:
        return head + data, head
    return head + head[1:] + data, bytes((function,)) + data


def words(function: int, *values: int) -> bytes:
    """A function and words of two bytes."""
    return bytes((function,)) + b"".join(each.to_bytes(2) for each in values)
