"""What a device gets when a client writes to a row of a virtual unit."""

from typing import cast

from gateway.errors import DoesNotFit, IllegalAddress, IllegalValue, StaleValue
from gateway.images.virtual.row import Row
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.pdu import RequestPdu, Span
from gateway.profiles.point import Point
from gateway.profiles.reading import Reading
from gateway.profiles.writing import Write, request_to_write
from gateway.registers.items import has_bits, unpack_bits, write_function


def write_to(row: Row, asked: RequestPdu, in_one_turn: int, before: bytes | None) -> Write:
    """Make the request to a row's device for a client's write that touches this row only.

    Registers as they are go on with their address moved; a value is converted. `in_one_turn` as in `Request`; `before`
    are the items of a value with a scale register, if they are fresh.

    Raises:
        IllegalAddress: the row takes no writes.
        IllegalValue: a value is not written as a whole, or does not fit. Its device guards its limits.
        StaleValue: a scale register is needed, and not known.
    """
    place, span = row.place, cast("Span", asked.write)
    if not row.mapped.write:
        raise IllegalAddress(f"{place.area} {place.addresses} takes no writes: its row has no `write = true`")
    if row.mapped.point is not None:
        return _write_of_value(row, row.mapped.point, asked, before)
    if in_one_turn and not row.source.profile.knows(in_one_turn):
        in_one_turn = int(write_function(Area.HOLDING, 1, row.source.profile.functions))
    moved = Span(row.poll.area, row.poll.first + span.start - place.start, span.count)
    return Write(asked.data[:1] + moved.start.to_bytes(2, "big") + asked.data[3:], moved, in_one_turn)


def _write_of_value(row: Row, point: Point, asked: RequestPdu, before: bytes | None) -> Write:
    place, needs_scale = row.place, point.scale_at is not None
    if asked.write != place or asked.function == FunctionCode.MASK_WRITE_REGISTER:
        raise IllegalValue(f"{place.area} {place.addresses} are one value: one write must set all of it")
    if needs_scale and before is None:
        raise StaleValue(f"the scale of {row.mapped.device} {point.name} is not known now", row.mapped.device)
    before = before if needs_scale else None
    own = None if row.back is None else row.back(_items(asked), before)
    if own is None:
        raise IllegalValue(f"the value does not fit {row.mapped.device} {point.name}")
    items = own if before is None else point.around(own, before)
    profile = row.source.profile
    try:
        return request_to_write([Reading(point, items, is_written=True)], profile.limits, profile.functions)
    except DoesNotFit as error:
        raise IllegalValue(str(error)) from error


def _items(asked: RequestPdu) -> bytes:
    """Take the items out of a write: two bytes for a register, one for a coil."""
    span = cast("Span", asked.write)
    if asked.function == FunctionCode.WRITE_SINGLE_COIL:
        return b"\1" if asked.data[3] else b"\0"
    return unpack_bits(asked.values, span.count) if has_bits(span.area) else asked.values
