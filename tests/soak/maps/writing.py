"""Writes through a map: what the device must get, what the client is answered, and writes that nobody may get."""

import random
from dataclasses import dataclass

from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.registers.items import pack_bits
from soak.dated import Write, Writes
from soak.judge import NO_ANSWER, WRITE, WRITE_SEVERAL, trouble_with_exception, words, write_request
from soak.maps.devices import MapDevice
from soak.maps.reading import Meaning
from soak.maps.rows import Row

_MASK_WRITE, _WRITE_AND_READ, _COIL, _COILS = 22, 23, 5, 15
_ILLEGAL_FUNCTION, _NO_ADDRESS, _BAD_VALUE = 1, 2, 3


@dataclass
class RowWrite:
    """A write to a row, as a client sends it, the right response, and what is to be written to the device."""

    meaning: Meaning
    area: Area
    pdu: bytes
    right: bytes
    write: Write
    device: MapDevice

    def trouble(self, response: bytes) -> str | None:
        """Say what is wrong with an answer."""
        write = self.write
        if response == self.right:
            write.is_acknowledged = True
            self.device.acknowledged(self.area, write)
            return None if write.done_at is not None else "the device has not done that"
        if response[0] != self.pdu[0] | EXCEPTION_BIT:
            return f"it is {self.right.hex(' ').upper()}"
        if response[1] == NO_ANSWER:
            return None
        write.is_refused = True
        if write.done_at is not None and self.area is Area.HOLDING:  # another write of coils may be the same
            return f"the device has done that at {write.done_at:.6f} s"
        return trouble_with_exception(response[1], of_device=True)


def to_row(
    dice: random.Random, writes: Writes, meaning: Meaning, row: Row, device: MapDevice, order: int
) -> RowWrite | None:
    """Make a write to a row; None if the value that came up does not fit it."""
    if row.area is Area.COILS:
        return _to_coils(dice, meaning, row, device, order)
    point = row.source.point
    if point is not None:
        write = writes.ask(device, point.written_at, point.count, order)
        shown = row.shown_of(write.values)
        if shown is None:
            return None
        function = WRITE if len(shown) == 1 and dice.random() < 0.5 else WRITE_SEVERAL
        pdu, right = write_request(function, row.at, list(shown))
        return RowWrite(meaning, Area.HOLDING, pdu, right, write, device)
    items = dice.randint(1, min(3, row.count))
    at = dice.randint(0, row.count - items)
    write = writes.ask(device, row.source.first + at, items, order)
    if items == 1 and dice.random() < 0.3:
        pdu = right = words(_MASK_WRITE, row.at + at, 0, write.values[0])
    else:
        function = WRITE if items == 1 and dice.random() < 0.5 else WRITE_SEVERAL
        pdu, right = write_request(function, row.at + at, write.values)
    return RowWrite(meaning, Area.HOLDING, pdu, right, write, device)


def _to_coils(dice: random.Random, meaning: Meaning, row: Row, device: MapDevice, order: int) -> RowWrite:
    items = 1 if row.source.point is not None else dice.randint(1, row.count)
    at = dice.randint(0, row.count - items)
    write = Write(device, row.source.first + at, [dice.randrange(2) for _ in range(items)], order)
    device.coil_writes.append(write)
    if items == 1 and dice.random() < 0.5:
        pdu = right = words(_COIL, row.at + at, 0xFF00 * write.values[0])
    else:
        data = pack_bits(bytes(write.values))
        right = words(_COILS, row.at + at, items)
        pdu = right + bytes((len(data),)) + data
    return RowWrite(meaning, Area.COILS, pdu, right, write, device)


@dataclass
class OwnWrite:
    """A write to own registers of a unit."""

    meaning: Meaning
    first: int
    values: list[int]

    @property
    def pdu(self) -> bytes:
        """The request."""
        return write_request(WRITE_SEVERAL, self.first, self.values)[0]

    def left(self) -> None:
        """The client has left: nobody knows."""
        for at, value in enumerate(self.values):
            self.meaning.own[self.first + at].lost.add(value)

    def trouble(self, response: bytes) -> str | None:
        """Say what is wrong with an answer. It is done when it is acknowledged."""
        right = write_request(WRITE_SEVERAL, self.first, self.values)[1]
        if response != right:
            return f"it is {right.hex(' ').upper()}"
        for at, value in enumerate(self.values):
            self.meaning.own[self.first + at].value = value
        return None


def to_own(dice: random.Random, meaning: Meaning) -> OwnWrite:
    """Make a write to own registers."""
    first = dice.choice(list(meaning.own))
    return OwnWrite(meaning, first, [dice.randrange(0x10000) for _ in range(meaning.map.own.stop - first)])


def wrong_write(dice: random.Random, writes: Writes, meaning: Meaning, order: int) -> tuple[bytes, int]:
    """Make a write that nobody may get, and the exception that it is answered."""
    pieces = meaning.pieces[Area.HOLDING]
    device = next(iter(meaning.devices.values()))
    value = writes.ask(device, 0, 2, order)
    value.is_refused = True
    kind = dice.randrange(3)
    both = [at for at in pieces if at + 1 in pieces and pieces[at] is not pieces[at + 1] and not _are_own(pieces, at)]
    closed = [
        at for at, piece in pieces.items() if piece in ("age", "fresh") or (isinstance(piece, Row) and not piece.write)
    ]
    if kind == 0 and both:
        return write_request(WRITE_SEVERAL, dice.choice(both), value.values)[0], _NO_ADDRESS
    if kind == 1 and closed:
        return write_request(WRITE, dice.choice(closed), value.values[:1])[0], _NO_ADDRESS
    values = [
        row
        for row in meaning.map.rows
        if row.write and row.area is Area.HOLDING and row.source.point is not None and row.count > 1
    ]
    if kind == 2 and values:
        row = dice.choice(values)
        return write_request(WRITE, row.at, value.values[:1])[0], _BAD_VALUE
    return write_request(_WRITE_AND_READ, 0, value.values[:1])[0], _ILLEGAL_FUNCTION


def _are_own(pieces: dict[int, object], at: int) -> bool:
    """Whether both addresses are the unit's own."""
    return all(not isinstance(pieces[each], Row | str) for each in (at, at + 1))
