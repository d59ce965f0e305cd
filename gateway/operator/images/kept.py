"""Values that the gateway has without asking a device: those of images, and those that it polls with their ages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from gateway.clock.times import milliseconds, optional_ms
from gateway.images.image import Image
from gateway.images.last_writes import LastWrite
from gateway.images.mirror import Mirror
from gateway.images.self_image import SelfImage
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.images.map_lines import place_there
from gateway.operator.status.unit_status import oldest
from gateway.operator.units.reached import Held, device_of, image_of
from gateway.profiles.profile import Range, covers
from gateway.registers.items import has_bits, unpack_bits
from gateway.runtime.gateway import Gateway


@dataclass(frozen=True, slots=True)
class Kept:
    """Coils or registers of an image or mirror. `age_ms` is 0 for an image, and None while a mirror's are unknown."""

    items: bytes
    age_ms: float | None
    is_stale: bool


@dataclass(frozen=True, slots=True)
class PolledAge:
    """Addresses that are polled, or only heard, with `every_ms` 0, and the age of their values; None while unknown.

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

    of: str
    persist: str
    stale_ms: float | None
    areas: Mapping[Area, tuple[Range, ...]]
    parts: Sequence[tuple[Span, bytes]]
    ages: Sequence[PolledAge]
    writes: Sequence[Written]


def kept(gateway: Gateway, unit: int, spans: Sequence[Span], now: float) -> list[Kept | None]:
    """Find what an image or a mirror has of each span; None for what it does not have."""
    image = image_of(gateway, unit)
    if image is None or isinstance(image, VirtualUnit):
        return [None] * len(spans)
    _look_again(image, now)
    ages, stale = (_ages(image, now), image.settings.stale) if isinstance(image, Mirror) else ([], inf)
    return [_kept(image, ages, stale * 1000, span, now) for span in spans]


def sampled(image: Held, span: Span, now: float) -> Iterator[tuple[Span, float]]:
    """Yield the addresses that `span` touches whose values were polled, and when; whatever else there is has no age."""
    if isinstance(image, Mirror):
        places = ((part.span, part.age(now)) for part in image.parts if part.span.touches(span))
    elif isinstance(image, VirtualUnit):
        places = ((row.place, row.age(now)) for row in image.block.touched(span).rows)
    else:
        return
    yield from ((place, now - age) for place, age in places if age is not None)


def mirrors_of(gateway: Gateway, unit: int) -> list[str]:
    """List the names of a device's mirrors."""
    device = device_of(gateway, unit)
    return [driver.name for driver in gateway.mirrors if device is not None and driver.unit.device is device]


def maps_of(gateway: Gateway, name: str) -> list[str]:
    """List the names of the virtual units that have values of the device or image of this name."""
    return [driver.name for driver in gateway.virtual if name in driver.pollers]


def window(gateway: Gateway, unit: int, span: Span, shown: Sequence[Span], now: float) -> ImageWindow | None:
    """Return the part of an image or mirror at the addresses of `span`, with the values of the parts that are `shown`.

    None if the unit is neither.
    """
    image = image_of(gateway, unit)
    if image is None:
        return None
    _look_again(image, now)
    areas = image.settings.areas
    return ImageWindow(
        of=image.settings.of if isinstance(image, Mirror) else "",
        persist=image.settings.persist if isinstance(image, Image) else "",
        stale_ms=None if isinstance(image, Image) else milliseconds(image.settings.stale),
        areas=areas,
        parts=[
            (each, _items(image, each, now)) for part in shown for each in _existing(areas.get(span.area, ()), part)
        ],
        ages=_ages_at(image, span, now),
        writes=[
            Written(each.span, each.client, milliseconds(now - each.at))
            for each in _last_writes(image)
            if each.span.touches(span)
        ],
    )


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


def _kept(image: Image | Mirror, ages: Sequence[PolledAge], stale_ms: float, span: Span, now: float) -> Kept | None:
    """Return what there is of a span; its age is that of the oldest part."""
    if not covers(image.settings.areas.get(span.area, ()), span):
        return None
    age = oldest(each.age_ms for each in ages if each.span.touches(span))
    return Kept(_items(image, span, now), age, is_stale=age is not None and age > stale_ms)


def _existing(ranges: Iterable[Range], span: Span) -> Iterator[Span]:
    """Yield the parts of a span that exist."""
    for first, last in ranges:
        start, end = max(first, span.start), min(last + 1, span.end)
        if start < end:
            yield Span(span.area, start, end - start)
