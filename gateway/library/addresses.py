"""Addresses and values as a program names them, checked before anything is sent."""

from collections.abc import Sequence
from operator import index
from struct import error, pack
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.profiles.profile import width_at
from gateway.registers.items import MOST_WIDE, REGISTER, has_bits, most_written

_LAST_ADDRESS: Final = 65535
#: How `struct` packs registers, and the largest number, by their bytes.
_LETTERS: Final = {2: "H", 4: "I"}


def span_to_read(unit: UnitPicture, area: Area, address: int, count: int) -> tuple[Span, int]:
    """Make the span of one read, and return the bytes of its registers too.

    Raises:
        ValueError: there are no such addresses, or one request reads fewer.
    """
    span, width = _span(unit, area, address, count)
    function, most = READERS[area]
    most = min(MOST_WIDE if width > REGISTER else most, unit.limits.get(function, most))
    if span.count > most:
        raise ValueError(f"{unit.name}: one request reads at most {most} of {area}, not {count}")
    return span, width


def span_to_write(unit: UnitPicture, area: Area, address: int, values: Sequence[int]) -> tuple[Span, int, bytes]:
    """Make the span of one write, and return the bytes of its registers and its items too.

    Raises:
        ValueError: there are no such addresses or values, or one request writes fewer.
    """
    span, width = _span(unit, area, address, len(values))
    most = most_written(area, unit.limits, width)
    if span.count > most:
        raise ValueError(f"{unit.name}: one request writes at most {most} of {area}, not {span.count}")
    return span, width, _bits(area, values) if has_bits(area) else _registers(area, values, width)


def _span(unit: UnitPicture, area: Area, address: int, count: int) -> tuple[Span, int]:
    span = Span(area, index(address), index(count))
    if span.count < 1:
        raise ValueError(f"{unit.name}: {count} of {area}: a request has one at least")
    if span.start < 0 or span.end > _LAST_ADDRESS + 1:
        raise ValueError(f"{unit.name}: {count} of {area} from {address} on: addresses are 0 to {_LAST_ADDRESS}")
    width = width_at(unit.wide, span) if unit.wide else REGISTER
    if width is None:
        raise ValueError(f"{unit.name}: only some of {area} {span.addresses} have four bytes: ask for them apart")
    return span, width


def _bits(area: Area, values: Sequence[int]) -> bytes:
    wrong = next((each for each in values if each not in (0, 1)), None)
    if wrong is not None:
        raise ValueError(f"{wrong!r} does not fit into {area}: False or True")
    return bytes(map(int, values))


def _registers(area: Area, values: Sequence[int], width: int) -> bytes:
    try:
        return pack(f">{len(values)}{_LETTERS[width]}", *values)
    except error:
        wrong = next((each for each in values if not _fits(each, width)), values)
        raise ValueError(f"{wrong!r} does not fit into {area}: whole numbers from 0 to {256**width - 1}") from None


def _fits(value: object, width: int) -> bool:
    return isinstance(value, int) and 0 <= value < 256**width
