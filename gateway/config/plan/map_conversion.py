"""How the value of a point is written in a virtual unit: as a row says, or as a point of the unit's profile is."""

from dataclasses import replace

from gateway.config.plan.map_place import MapTarget, RowPlace, WrongRow
from gateway.config.schema.image import Mapped
from gateway.profiles.point import LARGEST_SCALE, Point, Writing
from gateway.registers.datatypes import registers_of
from gateway.registers.items import REGISTER, has_bits

_BITS_OF_REGISTER = 16


def as_written(row: Mapped, point: Point, place: RowPlace, target: MapTarget) -> Point | None:
    """Make the point as it is written at this place; None if it has its registers, or its coil, as they are."""
    if place.point is not None:
        return _as_point_of_profile(row, point, place.point, target)
    if has_bits(place.area):
        return _as_coil(row, point, place)
    if row.type is not None:
        _check_text(point, row.type, "type")
        return _as_type(row, point, place, row.type, 1.0 if row.scale is None else row.scale, row.offset or 0.0)
    for key in ("swap", "scale", "offset"):
        if row.has(key):
            scale = f" and scale = {point.scale:g}" if point.scale != 1 else ""
            remedy = f'write type, too: {point.name} has type = "{point.type}"{scale}'
            raise WrongRow(key, "without type, registers are as the device has them", remedy)
    is_part = has_bits(point.area) or point.bits is not None
    if point.type == "string" or not is_part:
        return None
    return _as_type(row, point, place, _type_of_number(point), point.scale, point.offset)


def registers_as_they_are(point: Point) -> int:
    """Tell how many registers or coils a point takes as it is; a register of four bytes takes two."""
    return point.count if has_bits(point.area) else point.count * point.width // REGISTER


def _as_type(row: Mapped, point: Point, place: RowPlace, data_type: str, scale: float, offset: float) -> Point:
    return Point(
        point.name,
        place.area,
        place.start,
        data_type,
        row.swap or "none",
        _registers_of_text(point) if data_type == "string" else registers_of(data_type),
        scale,
        point.decimals,
        point.unit,
        write=_writing(row),
        offset=offset,
    )


def _as_coil(row: Mapped, point: Point, place: RowPlace) -> Point | None:
    for key in ("type", "swap", "scale", "offset"):
        if row.has(key):
            raise WrongRow(key, f"{place.area} are single bits", "take it out")
    if not point.is_bit:
        what = f"{point.name} of {row.device} is no single bit, as {place.area} are"
        raise WrongRow("point", what, 'write area = "holding", or take area out')
    return None if has_bits(point.area) else Point(point.name, place.area, place.start, "bit", write=_writing(row))


def _as_point_of_profile(row: Mapped, point: Point, target: Point, unit: MapTarget) -> Point:
    """Take over how a point of the profile is written."""
    if has_bits(target.area) and not point.is_bit:
        raise WrongRow("point", f"{point.name} of {row.device} is no single bit, as {target.area} {target.name} is")
    if not has_bits(target.area):
        _check_text(point, target.type, "point")
    return replace(_with_fixed_scale(target, unit), labels={}, write=_writing(row))


def _with_fixed_scale(target: Point, unit: MapTarget) -> Point:
    """Take the scale of a point out of its scale register, which must be one of the unit's own, with a value."""
    if target.scale_at is None:
        return target
    exponent = unit.initial_int16(target.area, target.scale_at)
    if exponent is None:
        at, area = target.scale_at, target.area
        remedy = f'make it one of the unit\'s own: {area} = "{at}", initial.{area} = [{{ at = {at}, values = [0] }}]'
        raise WrongRow("at", f"{target.name} has its scale in {area} {at}, which has no fixed value here", remedy)
    if abs(exponent) > LARGEST_SCALE:
        where = f"{target.area} {target.scale_at}"
        what = f"{target.name} has its scale in {where}, and {exponent} is too large a power of ten"
        raise WrongRow("at", what, f"let initial.{target.area} have {-LARGEST_SCALE} to {LARGEST_SCALE} there")
    return replace(target, scale=float(f"{target.scale * 10.0**exponent:.15g}"), scale_at=None)


def _check_text(point: Point, data_type: str, key: str) -> None:
    if point.type == "string" and data_type != "string":
        raise WrongRow(key, f"{point.name} is text, and {data_type} is a number", 'write type = "string", or none')
    if point.type != "string" and data_type == "string":
        raise WrongRow(key, f"{point.name} is a number, and string is text", "choose the type of a number")


def _writing(row: Mapped) -> Writing:
    return "yes" if row.write else "no"


def _registers_of_text(point: Point) -> int:
    """Tell how many registers a text takes; of some devices each register has one character only."""
    return (point.count + 1) // 2 if point.bits is not None else registers_as_they_are(point)


def _type_of_number(point: Point) -> str:
    """Choose the type for the number that some bits are: one register, unless they are more bits than it has."""
    if point.type == "int8":
        return "int16"
    first, last = point.bits or (0, 0)
    bits = last - first + 1
    return "uint16" if bits <= _BITS_OF_REGISTER else "uint32" if bits <= 2 * _BITS_OF_REGISTER else "uint64"
