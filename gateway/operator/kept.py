"""Values that the gateway has without asking a device: those of images, and those that it polls with their ages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from gateway.images.image import Image
from gateway.images.last_writes import LastWrite
from gateway.images.mirror import Mirror
from gateway.images.self_image import SelfImage
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.map_lines import place_there
from gateway.operator.reached import Held, device_of, image_of
from gateway.operator.status import milliseconds, optional_ms
from gateway.profiles.profile import Range, covers
from gateway.registers.items import has_bits, unpack_bits
from gateway.runtime.gateway import Gateway


@dataclass(frozen=True, slots=True)
class Kept:
    """Coils or registers that the image or mirror `name` has.

    `age_ms` is 0 for an image, and None while a mirror's values are unknown.
    """

    name: str
    items: bytes
    age_ms: float | None
    is_stale: bool


@dataclass(frozen=True, slots=True)
class PolledAge:
    """Addresses that are polled, and the age of their values; None while unknown.

    The values of a virtual unit come from a `source`, `meter-1 power`, and may not be a `valid` one.
    """

    span: Span
    every_ms: float
    age_ms: float | None
    source: str = ""
    is_valid: bool = True


@dataclass(frozen=True, slots=True)
class Written:
    """The last write to these addresses, `ago_ms` ago."""

    span: Span
    client: str
    ago_ms: float


@dataclass(frozen=True, slots=True)
class ImageWindow:
    """Some addresses of an image or mirror: `parts` are those that exist, with two bytes for a register, one for a bit.

    Only mirrors and virtual units have `stale_ms` and `ages`; own registers of the latter have no age. `writes` are the
    last ones, newest first.
    """

    unit: int
    name: str
    of: str
    persist: str
    stale_ms: float | None
    areas: Mapping[Area, tuple[Range, ...]]
    parts: Sequence[tuple[Span, bytes]]
    ages: Sequence[PolledAge]
    writes: Sequence[Written]


def kept(gateway: Gateway, unit: int, spans: Sequence[Span], now: float) -> list[Kept | None]:
    """Find what an image, a mirror, or the mirrors of a device have of each span; None for what they do not have."""
    image = image_of(gateway, unit)
    if isinstance(image, Image):
        _look_again(image, now)
        tables, name = image.tables, image.settings.name
        has = [tables[span.area].has(span) for span in spans]
        return [
            Kept(name, _items(image, span, now), 0.0, is_stale=False) if it else None
            for span, it in zip(spans, has, strict=True)
        ]
    mirrors = [image] if isinstance(image, Mirror) else _mirrors_of(gateway, unit)
    polled = [(mirror, _ages(mirror, now)) for mirror in mirrors]
    return [next(filter(None, (_kept(mirror, ages, span, now) for mirror, ages in polled)), None) for span in spans]


def mirrors_of(gateway: Gateway, unit: int) -> list[str]:
    """List the names of a device's mirrors."""
    return [mirror.settings.name for mirror in _mirrors_of(gateway, unit)]


def maps_of(gateway: Gateway, name: str) -> list[str]:
    """List the names of the virtual units that have values of the device or image of this name."""
    return [driver.name for driver in gateway.virtual if name in driver.pollers]


def window(gateway: Gateway, unit: int, span: Span, now: float) -> ImageWindow | None:
    """Return the part of an image or mirror at the addresses of `span`; None if the unit is neither."""
    image = image_of(gateway, unit)
    if image is None:
        return None
    _look_again(image, now)
    settings = image.settings
    return ImageWindow(
        unit=unit,
        name=settings.name,
        of=image.settings.of if isinstance(image, Mirror) else "",
        persist=image.settings.persist if isinstance(image, Image) else "",
        stale_ms=None if isinstance(image, Image) else milliseconds(image.settings.stale),
        areas=settings.areas,
        parts=[(each, _items(image, each, now)) for each in _existing(settings.areas.get(span.area, ()), span)],
        ages=_ages_at(image, span, now),
        writes=[
            Written(each.span, each.client, milliseconds(now - each.at))
            for each in _last_writes(image)
            if each.span.touches(span)
        ],
    )


def _mirrors_of(gateway: Gateway, unit: int) -> list[Mirror]:
    device = device_of(gateway, unit)
    return [driver.unit for driver in gateway.mirrors if driver.unit.device is device] if device is not None else []


def _look_again(image: Held, now: float) -> None:
    if isinstance(image, SelfImage):
        image.look_again(now)


def _last_writes(image: Held) -> Iterable[LastWrite]:
    """List the last writes, the newest first; those of a virtual unit are to its sources or to its own registers."""
    if not isinstance(image, VirtualUnit):
        return image.last_writes
    return sorted((*image.last_writes, *image.block.own.last_writes), key=lambda write: -write.at)


def _items(image: Held, span: Span, now: float) -> bytes:
    if isinstance(image, VirtualUnit):
        data = image.block.values(image.block.touched(span), now)
    else:
        data = image.values(span) if isinstance(image, Mirror) else image.tables[span.area].read(span)
    return unpack_bits(data, span.count) if has_bits(span.area) else data


def _ages_at(image: Held, span: Span, now: float) -> list[PolledAge]:
    """List the ages of what is polled at these addresses."""
    if isinstance(image, Mirror):
        return [each for each in _ages(image, now) if each.span.touches(span)]
    if isinstance(image, Image):
        return []
    return [
        PolledAge(
            row.place,
            milliseconds(row.poll.every),
            optional_ms(row.age(now)),
            f"{row.mapped.device} {place_there(row)}",
            row.is_valid,
        )
        for row in image.block.touched(span).rows
    ]


def _ages(mirror: Mirror, now: float) -> list[PolledAge]:
    return [PolledAge(poll.span, milliseconds(poll.every), optional_ms(age)) for poll, age in mirror.ages(now)]


def _kept(mirror: Mirror, ages: Sequence[PolledAge], span: Span, now: float) -> Kept | None:
    """Return what a mirror has of a span; its age is that of the oldest part."""
    if not covers(mirror.settings.areas.get(span.area, ()), span):
        return None
    touched = [each.age_ms for each in ages if each.span.touches(span)]
    known = [age for age in touched if age is not None]
    age = max(known, default=0.0) if len(known) == len(touched) else None
    is_stale = age is not None and age > mirror.settings.stale * 1000
    return Kept(mirror.settings.name, _items(mirror, span, now), age, is_stale)


def _existing(ranges: Iterable[Range], span: Span) -> Iterator[Span]:
    """Yield the parts of a span that exist."""
    for first, last in ranges:
        start, end = max(first, span.start), min(last + 1, span.end)
        if start < end:
            yield Span(span.area, start, end - start)
