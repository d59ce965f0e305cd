"""How values are written at points: with one request, for all who write by name."""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass

from gateway.errors import DoesNotFit
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.reading import Reading
from gateway.registers.items import (
    REGISTER,
    WRITERS,
    WriteFunction,
    has_bits,
    most_written,
    write_function,
    write_request,
)
from gateway.registers.masks import mask_request


def to_be_writable(point: Point) -> str:
    """Name the keys that make a read-only point writable: input registers can only be written elsewhere."""
    return "write = true" if point.area in WRITERS else "write = true and write_at = ADDRESS"


@dataclass(frozen=True, slots=True)
class Write:
    """A request PDU that writes, and where. `in_one_turn` as in `Request`."""

    pdu: bytes
    span: Span
    in_one_turn: int = 0


def written(point: Point, text: str, before: bytes | None = None) -> Reading:
    """Make the reading of a point after `text` was written there. `before` as for `Point.items`.

    Raises:
        ValueError: the point cannot hold it.
    """
    own = point.items(text, before)
    return Reading(point, own if before is None else point.around(own, before), is_written=True)


def writes_of(point: Point) -> list[bytes]:
    """Make the requests of which one would write a point alone, to see whether they are allowed."""
    span = point.write_span
    if point.bits is not None:
        return [mask_request(address, 0, 0) for address in range(span.start, span.end)]
    items = bytes(span.count if has_bits(span.area) else span.count * point.width)
    hows: tuple[WriteFunction, ...] = ("auto", "multiple")
    return [write_request(span.area, span.start, items, how=how, width=point.width) for how in hows]


def request_to_write(
    readings: Iterable[Reading],
    limits: Mapping[int, int],
    functions: Container[int] | None = None,
    *,
    multiple: bool = False,
) -> Write:
    """Make the request that writes these values, to a device that knows `functions` (None: all).

    Bits of a register are written alone, other values if they lie side by side. With `multiple`, one item is written
    with function 15 or 16 too.

    Raises:
        DoesNotFit: they cannot be written, do not lie side by side, or are too many.
    """
    readings = sorted(readings, key=lambda each: each.point.write_span.start)
    first = readings[0].point
    for each in readings:
        if each.point.area not in WRITERS and each.point.write_at is None:
            raise DoesNotFit(f"{each.point.area} cannot be written", "coils and holding can")
    if any(each.point.bits is not None for each in readings):
        return _request_for_bits(readings, functions, multiple=multiple)
    span = _joined([each.point for each in readings])
    most = most_written(span.area, limits, first.width)
    if span.count > most:
        raise DoesNotFit(f"{span.count} {_items(span)} are too many for one request", f"write at most {most} at a time")
    how = "multiple" if multiple else _function([each.point for each in readings], span)
    items = b"".join(each.point.own(each.items) for each in readings)
    return Write(write_request(span.area, span.start, items, functions, how=how, width=first.width), span)


def _request_for_bits(readings: Sequence[Reading], functions: Container[int] | None, *, multiple: bool) -> Write:
    """Make the request that writes bits of a register and keeps the others."""
    point, name = readings[0].point, readings[0].point.name
    if len(readings) > 1:
        raise DoesNotFit("bits of a register are written alone", "write the points one by one")
    masks = point.register_masks
    touched = [at for at, mask in enumerate(masks) if mask]
    if len(touched) > 1 or point.width != REGISTER:
        raise DoesNotFit(f"{name} cannot be written: one request writes bits of one register of 16 bits")
    at = touched[0]
    span = Span(Area.HOLDING, point.write_span.start + at, 1)
    pdu = mask_request(span.start, masks[at], _registers(point.own(readings[0].items))[at])
    if functions is not None and FunctionCode.MASK_WRITE_REGISTER in functions and not point.in_turn:
        return Write(pdu, span)
    how: WriteFunction = "multiple" if multiple else point.write_function
    return Write(pdu, span, int(write_function(Area.HOLDING, 1, functions, how=how)))


def _registers(items: bytes) -> list[int]:
    return [int.from_bytes(items[at : at + REGISTER], "big") for at in range(0, len(items), REGISTER)]


def _joined(points: Sequence[Point]) -> Span:
    """Join the places where points are written."""
    place, width = points[0].write_span, points[0].width
    end = place.start
    for each in points:
        span = each.write_span
        if (span.area, span.start, each.width) != (place.area, end, width):
            raise DoesNotFit("what one request writes must lie side by side", "write them one by one")
        end = span.end
    return Span(place.area, place.start, end - place.start)


def _function(points: Sequence[Point], span: Span) -> WriteFunction:
    """Choose the functions that all of the points allow."""
    wanted = {each.write_function for each in points}
    if "single" in wanted and span.count > 1 and points[0].width == REGISTER:
        what = f"{span.count} {_items(span)} are too many for one request"
        raise DoesNotFit(what, f"the profile wants function {int(WRITERS[span.area][0]):02}, which writes one")
    return "multiple" if "multiple" in wanted else "single" if "single" in wanted else "auto"


def _items(span: Span) -> str:
    return "coils" if has_bits(span.area) else "registers"
