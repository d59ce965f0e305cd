"""Scales on a line that change their addresses: what they hold, and the exceptions they answer with, say whose it is.

A scale works in order, one request after the other, or not: then each request takes its own time. Its answer comes from
the address that it has by then. It comes as late as a late window allows, or never.
"""

import asyncio
import random
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, Area
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.modbus.rtu import encode
from kit.faulty import Fault, word
from kit.memory import MemoryLine
from kit.noise import flipped
from soak.tally import Tally

ADDRESS_REGISTER: Final = 0x0100
#: What the gateway allows a scale, in seconds; the latest time for a scale to do what it was asked.
TIMEOUT: Final = 0.1
LATEST: Final = 0.3
#: An answer is late from then on: after the time-out, the frames on the wire and the latency of the port.
_LATE: Final = 0.14
_SOON: Final = (0.002, 0.06)
#: A second copy comes while the line is silent, before any other request.
_AT_ONCE: Final = 0.001
#: The exception code of scale 3 is 23; the gateway has none like it.
EXCEPTIONS: Final = 0x20

_FAULTS: Final = (
    *(Fault.LATE, Fault.LATE, Fault.LATE_EXCEPTION, Fault.EXCEPTION, Fault.SILENT, Fault.SILENT, Fault.DUPLICATE),
    *(Fault.FLIPPED, Fault.CUT),
)


@dataclass(eq=False)
class Scale:
    """One scale. What it was asked before it was switched off is not done any more.

    `faults` are the latest ones, by request. `under_way` are the requests that it has not answered yet.
    """

    number: int
    unit: int
    in_order: bool
    is_off: bool = False
    faults: dict[bytes, Fault] = field(default_factory=dict)
    under_way: Counter[bytes] = field(default_factory=Counter)
    starts: int = 0
    busy_until: float = 0.0

    def start(self, unit: int) -> None:
        """Begin anew at this address, on or off."""
        self.unit, self.is_off, self.busy_until = unit, False, 0.0
        self.under_way.clear()
        self.starts += 1

    def respond(self, asked: RequestPdu) -> bytes:
        """Do what a request asks for; the response PDU."""
        if sets_address(asked) and asked.write is not None:
            at = 2 * (ADDRESS_REGISTER - asked.write.start)
            self.unit = int.from_bytes(asked.values[at : at + 2])
        if asked.read is None:
            return asked.response_head
        return asked.response_head + words(self.number, asked.read.start, asked.read.count)


def sets_address(asked: RequestPdu) -> bool:
    """Whether a scale has another address after this."""
    return asked.write is not None and asked.write.start <= ADDRESS_REGISTER < asked.write.end


def words(number: int, start: int, count: int) -> bytes:
    """What these registers of a scale hold."""
    return b"".join(word(number, Area.HOLDING, address).to_bytes(2) for address in range(start, start + count))


class ScalesLine:
    """The far end of a line with scales on it. What must not happen there is told to the `tally`."""

    def __init__(self, line: MemoryLine, scales: list[Scale], share: float, seed: int, tally: Tally) -> None:
        self.scales = scales
        #: When a change of an address was sent last.
        self.changed_at = 0.0
        self._line = line
        self._share = share
        self._dice = random.Random(seed)
        self._tally = tally
        self._loop = asyncio.get_running_loop()
        line.on_write = self._hear

    @property
    def is_settled(self) -> bool:
        """Whether no change of an address may still be carried out."""
        return self._loop.time() > self.changed_at + LATEST

    def is_empty(self, unit: int) -> bool:
        """Whether no scale has this address."""
        return all(scale.unit != unit for scale in self.scales)

    def _hear(self, data: bytes) -> None:
        self._line.written.clear()
        self._tally.transactions += 1
        unit, asked = data[0], parse_request(data[1:-2])
        if sets_address(asked):
            self.changed_at = self._loop.time()
        if unit == BROADCAST_UNIT and sets_address(asked):
            self._tally.complain(f"all scales get one address: {data.hex(' ')}")
        for scale in self.scales:
            if not scale.is_off and scale.unit == unit:
                self._begin(scale, asked)
            elif not scale.is_off and unit == BROADCAST_UNIT:
                scale.respond(asked)

    def _begin(self, scale: Scale, asked: RequestPdu) -> None:
        now = self._loop.time()
        fault = self._dice.choice(_FAULTS) if self._dice.random() < self._share else Fault.NONE
        if fault is Fault.DUPLICATE and scale.under_way[asked.data]:
            fault = Fault.NONE  # the copy would count as the response to the earlier sending: nobody can detect that
        done_at = now + self._dice.uniform(*((_LATE, LATEST) if "late" in fault else _SOON))
        if scale.in_order:
            done_at = max(done_at, scale.busy_until + _AT_ONCE)
        if done_at > now + LATEST or (fault is Fault.SILENT and self._dice.random() < 0.5):
            fault = Fault.SILENT  # it has not heard the request, or has no time for it
        else:
            scale.busy_until = done_at
            scale.under_way[asked.data] += 1
            self._loop.call_at(done_at, self._end, scale, scale.starts, asked, fault)
        scale.faults[asked.data] = fault
        self._tally.injected[fault.value] += 1

    def _end(self, scale: Scale, starts: int, asked: RequestPdu, fault: Fault) -> None:
        if scale.is_off or scale.starts != starts:
            return
        scale.under_way[asked.data] -= 1
        before = scale.unit
        if "exception" in fault:
            pdu = bytes((asked.function | EXCEPTION_BIT, EXCEPTIONS + scale.number))
        else:
            pdu = scale.respond(asked)
        if scale.unit != before:
            self._find_neighbour(scale)
        if fault is not Fault.SILENT:
            self._deliver(encode(scale.unit, pdu), fault)

    def _find_neighbour(self, scale: Scale) -> None:
        for other in self.scales:
            if other is not scale and other.unit == scale.unit:
                self._tally.complain(f"scales {scale.number} and {other.number} both have the address {scale.unit}")

    def _deliver(self, frame: bytes, fault: Fault) -> None:
        if fault is Fault.FLIPPED:
            frame = flipped(frame, self._dice.randrange(8 * len(frame)))
        elif fault is Fault.CUT:
            frame = frame[: self._dice.randrange(1, len(frame))]
        self._line.deliver(frame)
        if fault is Fault.DUPLICATE:
            self._loop.call_later(_AT_ONCE, self._line.deliver, frame)
