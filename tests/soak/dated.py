"""Devices whose values say whose they are and when they held them, and which know what may be written to them.

Input registers come in pairs, which say device, pair and time, to a tenth of a millisecond. Holding registers hold
numbers that are given out once, each for one register of one device: so what a device held, and when, is known.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.pdu import RequestPdu
from kit.faulty import FaultyDevice

#: Input registers are 0 to 2 * PAIRS - 1, holding registers that are written 0 to CELLS - 1.
PAIRS: Final = 4
CELLS: Final = 8
#: Ticks in a second, and how many of them until the time in a pair begins anew: seven minutes.
_TICKS: Final = 10_000
_ROUND: Final = 1 << 22
#: For so many seconds a device remembers what it held.
_MEMORY: Final = 60.0
_NUMBERS: Final = 0x10000


@dataclass(eq=False)
class Write:
    """A write from `first` on that a client has asked for, the `order`th of its requests, and what has become of it."""

    device: "DatedDevice"
    first: int
    values: list[int]
    order: int
    done_at: float | None = None
    is_acknowledged: bool = False
    #: The client was told that nothing was done.
    is_refused: bool = False

    @property
    def addresses(self) -> range:
        """Of the registers."""
        return range(self.first, self.first + len(self.values))

    def touches(self, span: range) -> bool:
        """Whether it changes any of these addresses."""
        return self.first < span.stop and span.start < self.addresses.stop


class Writes:
    """All writes of a run by the numbers that they write. `complain` takes what devices should not have done."""

    def __init__(self, complain: Callable[[str], None]) -> None:
        self.complain = complain
        self._last = 0
        self._of: dict[int, Write] = {}

    def ask(self, device: "DatedDevice", first: int, count: int, order: int) -> Write:
        """A write of so many registers of a device. Numbers are used again after 65536."""
        write = Write(device, first, [(self._last + each) % _NUMBERS for each in range(count)], order)
        self._last += count
        self._of |= dict.fromkeys(write.values, write)
        return write

    def of(self, number: int) -> Write | None:
        """The write that writes this number."""
        return self._of.get(number)

    def done(self, device: "DatedDevice", first: int, values: list[int], now: float) -> None:
        """A device does what it was asked for."""
        write = self._of.get(values[0])
        if write is None or (write.first, write.values) != (first, values):
            self.complain(f"device {device.number} was written {values} from {first} on, which nobody asked for")
        elif write.device is not device:
            self.complain(f"device {device.number} was written {values}, which is for device {write.device.number}")
        elif write.done_at is not None:
            self.complain(f"device {device.number} was written {values} at {now:.6f} s and at {write.done_at:.6f} s")
        elif write.is_refused:
            self.complain(f"device {device.number} was written {values} after the client was told that it was not")
        else:
            write.done_at = now


class DatedDevice(FaultyDevice):
    """A device whose values say whose they are and when it held them."""

    def __init__(
        self, unit: int, *, number: int, writes: Writes, clock: Callable[[], float], timeout: float = 0.05
    ) -> None:
        super().__init__(unit, number=number, timeout=timeout)
        self._writes = writes
        self._clock = clock
        #: What its cells held, and from when on; the oldest first.
        self._held = deque([(clock(), self.holding[:CELLS])])

    def respond(self, pdu: bytes) -> bytes:
        """Act on a request; the right answer."""
        ticks = floor(self._clock() * _TICKS) % _ROUND
        for pair in range(PAIRS):
            self.input[2 * pair : 2 * pair + 2] = divmod(self.number << 26 | pair << 22 | ticks, _NUMBERS)
        return super().respond(pdu)

    def trouble(self, area: Area, first: int, words: Sequence[int], since: float, until: float) -> str | None:
        """Say what is wrong with registers from `first` on that it is to have held at one moment of this time."""
        if area is Area.INPUT:
            return self._trouble_with_pairs(first, words, since, until)
        held = []
        for at, cells in reversed(self._held):
            if at <= until:
                held.append(cells[first : first + len(words)])
            if at <= since:
                break
        return None if list(words) in held else f"it held {held} from {since:.6f} to {until:.6f} s"

    def _trouble_with_pairs(self, first: int, words: Sequence[int], since: float, until: float) -> str | None:
        begin, end = floor(since * _TICKS), floor(until * _TICKS)
        times = set()
        for at in range(0, len(words), 2):
            value = words[at] * _NUMBERS + words[at + 1]
            number, pair = value >> 26, value >> 22 & 0xF
            if (number, pair) != (self.number, (first + at) // 2):
                return f"that is pair {pair} of device {number}, not {(first + at) // 2} of device {self.number}"
            times.add((value - begin) % _ROUND)
        if len(times) > 1:
            return f"the pairs are {(max(times) - min(times)) / _TICKS:.4f} s apart"
        after = times.pop()
        if after <= end - begin:
            return None
        after = after - _ROUND if after > _ROUND // 2 else after
        return f"that was so at {(begin + after) / _TICKS:.4f} s, not from {since:.6f} to {until:.6f} s"

    def _write(self, asked: RequestPdu, values: list[int]) -> None:
        super()._write(asked, values)
        now = self._clock()
        self._writes.done(self, asked.write.start, list(values), now)
        self._held.append((now, self.holding[:CELLS]))
        while self._held[1][0] < now - _MEMORY:
            self._held.popleft()
