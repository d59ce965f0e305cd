"""What the pages of a unit and of an image show: times against limits, failures, and what is kept of its values."""

import asyncio
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final

from gateway.devices.device import Device
from gateway.errors import WrongQuestion
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.self_image import SelfImage
from gateway.lines.counts import Counts
from gateway.modbus.pdu import Span
from gateway.operator.calibration import measured
from gateway.operator.status import milliseconds, optional_ms
from gateway.operator.stories import Story, sentences
from gateway.operator.trace import causes
from gateway.operator.trace_reader import what_is_seen
from gateway.profiles.profile import Range, covers
from gateway.registers.items import has_bits, unpack_bits
from gateway.runtime.build import Gateway
from gateway.timing.histogram import SECONDS
from gateway.timing.measured import Times
from gateway.timing.proposal import MeasuredTimes, Proposal
from gateway.timing.verdict import CLOSE, ENOUGH_TO_SHORTEN, verdict
from gateway.trace.pdus import request_in_words
from gateway.web.api.unit_answers import Failure, FunctionTimes, ImageWindow, Kept, PolledAge, Written

#: At most this many failures are shown.
MOST_FAILURES: Final = 6


def may(gateway: Gateway, unit: int, function: int, host: str) -> bool:
    """See UnitAnswers."""
    right = gateway.web.rights[host][unit]
    return function in right or bytes((function,)) in right


def target(gateway: Gateway, unit: int) -> object:
    """See UnitAnswers."""
    return _device(gateway, unit) or _image(gateway, unit)


def answer_times(gateway: Gateway, unit: int) -> tuple[FunctionTimes, ...]:
    """See UnitAnswers."""
    device = _device(gateway, unit)
    if device is None:
        return ()
    proposed = _proposed(gateway, unit)
    found = sorted(device.counts.times.items())
    return tuple(_times(function, times, device.counts[function], proposed.get(function)) for function, times in found)


def failures(gateway: Gateway, unit: int, host: str) -> tuple[Failure, ...]:
    """See UnitAnswers.

    Raises:
        WrongQuestion: nothing is kept.
    """
    clock = asyncio.get_running_loop().time(), time.time()
    told = causes(gateway, unit, MOST_FAILURES, clock, what_is_seen(gateway, host))
    return tuple(_failure(story, not_sent) for story, not_sent in told)


def _failure(story: Story, not_sent: Mapping[str, int]) -> Failure:
    asked = request_in_words(bytes.fromhex(story["request"]))
    return Failure(story["received"], story["client"], asked, sentences(story), tuple(sorted(not_sent.items())))


def kept(gateway: Gateway, unit: int, spans: Sequence[Span], now: float) -> list[Kept | None]:
    """See UnitAnswers."""
    image = _image(gateway, unit)
    if isinstance(image, Image):
        _look_again(image, now)
        tables, name = image.tables, image.settings.name
        has = [tables[span.area].has(span) for span in spans]
        return [
            Kept(name, _items(image, span), 0.0, is_stale=False) if it else None
            for span, it in zip(spans, has, strict=True)
        ]
    mirrors = [image] if isinstance(image, Mirror) else _mirrors_of(gateway, unit)
    polled = [(mirror, _ages(mirror, now)) for mirror in mirrors]
    return [next(filter(None, (_kept(mirror, ages, span) for mirror, ages in polled)), None) for span in spans]


def mirrors_of(gateway: Gateway, unit: int) -> list[str]:
    """See UnitAnswers."""
    return [mirror.settings.name for mirror in _mirrors_of(gateway, unit)]


def window(gateway: Gateway, unit: int, span: Span, now: float) -> ImageWindow | None:
    """See UnitAnswers."""
    image = _image(gateway, unit)
    if image is None:
        return None
    _look_again(image, now)
    settings = image.settings
    parts = [(each, _items(image, each)) for each in _existing(settings.areas.get(span.area, ()), span)]
    ages = [each for each in _ages(image, now) if _touch(each.span, span)] if isinstance(image, Mirror) else []
    writes = [
        Written(each.span, each.client, milliseconds(now - each.at))
        for each in image.last_writes
        if _touch(each.span, span)
    ]
    return ImageWindow(
        unit=unit,
        name=settings.name,
        of=image.settings.of if isinstance(image, Mirror) else "",
        persist="" if isinstance(image, Mirror) else image.settings.persist,
        stale_ms=milliseconds(image.settings.stale) if isinstance(image, Mirror) else None,
        areas=settings.areas,
        parts=parts,
        ages=ages,
        writes=writes,
    )


def _device(gateway: Gateway, unit: int) -> Device | None:
    """The device that every client knows by this number, not one that only the listener for its line leads to."""
    for line in gateway.lines:
        if unit in line.devices and unit not in line.plan.own_units:
            return line.devices[unit]
    return next((each.devices[unit] for each in gateway.upstreams if unit in each.devices), None)


def _image(gateway: Gateway, unit: int) -> Image | Mirror | None:
    images: tuple[Image | Mirror, ...] = (*gateway.images, *(driver.mirror for driver in gateway.mirrors))
    return next((image for image in images if image.settings.unit == unit), None)


def _mirrors_of(gateway: Gateway, unit: int) -> list[Mirror]:
    device = _device(gateway, unit)
    return [driver.mirror for driver in gateway.mirrors if driver.device is device] if device is not None else []


def _times(function: int, times: Times, counts: Counts, proposed_ms: float | None) -> FunctionTimes:
    share, limit_ms, p99_ms = times.share.quantile(0.99), times.limit * 1000, optional_ms(times.answer.quantile(0.99))
    if proposed_ms is not None:  # exceptions and late responses are not in the samples
        proposed_ms = max(proposed_ms, p99_ms or 0.0, milliseconds(times.latest / CLOSE))
    return FunctionTimes(
        function=function,
        responses=counts.responses,
        timeouts=counts.timeout,
        late=times.late,
        latest_ms=milliseconds(times.latest),
        latest_limit_ms=milliseconds(times.latest_limit),
        bounds_ms=tuple(bound * 1000 for bound in SECONDS.bounds),
        counts=tuple(times.answer.counts),
        p50_ms=optional_ms(times.answer.quantile(0.5)),
        p99_ms=p99_ms,
        share_p99=share,
        limit_ms=milliseconds(times.limit) or None,
        proposed_ms=proposed_ms,
        verdict=verdict(share, counts.responses, times.late, limit_ms, proposed_ms),
    )


def _proposed(gateway: Gateway, unit: int) -> Mapping[int, float]:
    """For each function the limit of its longest requests that `calibrate` would propose, in milliseconds."""
    try:
        about = measured(gateway, unit)
    except WrongQuestion:
        return {}
    rows = [
        MeasuredTimes(
            each.function,
            each.items,
            tuple(time / 1000 for time in each.times_ms),
            each.limit_ms,
            each.allowed_ms,
            each.longest_ms / 1000,
        )
        for each in about.rows
    ]
    proposal, count = Proposal(rows, about.margin), Counter[int]()
    for each in about.rows:
        count[each.function] += each.count
    of_function = {function: list(each) for function, each in groupby(rows, lambda row: row.function)}
    return {
        function: milliseconds(max(map(proposal.limit, each)))
        for function, each in of_function.items()
        if count[function] >= ENOUGH_TO_SHORTEN
    }


def _look_again(image: Image | Mirror, now: float) -> None:
    if isinstance(image, SelfImage):
        image.look_again(now)


def _items(image: Image | Mirror, span: Span) -> bytes:
    data = image.values(span) if isinstance(image, Mirror) else image.tables[span.area].read(span)
    return unpack_bits(data, span.count) if has_bits(span.area) else data


def _ages(mirror: Mirror, now: float) -> list[PolledAge]:
    return [
        PolledAge(Span(poll.area, poll.first, poll.last - poll.first + 1), milliseconds(poll.every), optional_ms(age))
        for poll, age in mirror.ages(now)
    ]


def _kept(mirror: Mirror, ages: Sequence[PolledAge], span: Span) -> Kept | None:
    """What a mirror has of a span: as old as its oldest part."""
    if not covers(mirror.settings.areas.get(span.area, ()), span):
        return None
    touched = [each.age_ms for each in ages if _touch(each.span, span)]
    known = [age for age in touched if age is not None]
    age = max(known, default=0.0) if len(known) == len(touched) else None
    is_stale = age is not None and age > mirror.settings.stale * 1000
    return Kept(mirror.settings.name, _items(mirror, span), age, is_stale)


def _existing(ranges: Iterable[Range], span: Span) -> Iterator[Span]:
    """The parts of a span that exist."""
    for first, last in ranges:
        start, end = max(first, span.start), min(last + 1, span.end)
        if start < end:
            yield Span(span.area, start, end - start)


def _touch(one: Span, other: Span) -> bool:
    return one.area == other.area and one.start < other.end and other.start < one.end
