"""The part of the status about units: devices, images, mirrors and virtual units."""

import asyncio
from collections.abc import Iterable, Iterator
from typing import Literal

from gateway.clock.slices import in_slices
from gateway.clock.times import milliseconds, optional_ms
from gateway.devices.device import Device
from gateway.images.custom_image import CustomImage
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.virtual.unit import VirtualUnit
from gateway.lines.breaker import Breaker
from gateway.lines.counts import total, total_of_units
from gateway.operator.operations.answers.status import (
    ImageStatus,
    MirrorStatus,
    MovedStatus,
    RangeStatus,
    SourceStatus,
    TimesStatus,
    UnitStatus,
    VirtualStatus,
)
from gateway.operator.status.virtual_sources import source_states
from gateway.runtime.gateway import Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.timing.histogram import SECONDS, SHARES, merged
from gateway.timing.measured import NEVER, Times


def unit_status(parts: Owner, device: Device, now: float) -> UnitStatus:
    """Make the status of a device."""
    settings, breaker, counts = device.settings, device.breaker, device.counts
    times = {function: counts.times[function] for function in counts}
    return UnitStatus(
        line=parts.name,
        unit=settings.client_unit,
        on_the_wire=device.unit,
        name=settings.name,
        source=settings.source,
        profile=settings.profile.name,
        state="line down" if parts.reconnector.error is not None else _unit_state(breaker, now),
        failures=breaker.failures,
        rests_ms=milliseconds(breaker.rest_left(now)),
        last_answer_ms=ago_ms(max((each.answered_at for each in times.values()), default=NEVER), now),
        last_error=counts.last_error,
        last_error_ms=ago_ms(counts.last_error_at, now),
        longest_wait_ms=milliseconds(parts.longest_wait[settings.name]),
        counts=total_of_units([counts]),
        times=_times(times.values()),
        exceptions=dict(counts.codes),
        functions={function: total([each]) for function, each in counts.items()},
        function_times={function: _times([each]) for function, each in times.items()},
    )


def _unit_state(breaker: Breaker, now: float) -> Literal["fine", "failing", "resting"]:
    if breaker.is_resting(now):
        return "resting"
    return "failing" if breaker.failures else "fine"


def moved(lines: Iterable[GatewayLine]) -> Iterator[MovedStatus]:
    """List the devices that are, or may be, elsewhere than the config says."""
    for line in lines:
        for device in line.devices.values():
            if device.moved_from is not None:
                units, failures = device.possible_units, device.breaker.failures
                unit, configured = device.settings.client_unit, device.moved_from
                yield MovedStatus(line.name, unit, device.name, units, configured, failures)


def image_status(image: Image, now: float) -> ImageStatus:
    """Make the status of an image."""
    settings, counts = image.settings, image.counts
    breaker = image.breaker if isinstance(image, CustomImage) else None
    return ImageStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        requests=counts.requests,
        exceptions=counts.exceptions,
        python=settings.python,
        timeout_ms=milliseconds(settings.timeout) if settings.python else 0.0,
        state="" if breaker is None else _unit_state(breaker, now),
        rests_ms=0.0 if breaker is None else milliseconds(breaker.rest_left(now)),
    )


def mirror_status(mirror: Mirror, now: float) -> MirrorStatus:
    """Make the status of a mirror."""
    settings, answers, counts = mirror.settings, mirror.answer_counts, mirror.counts
    return MirrorStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        of=settings.of,
        requests=answers.requests,
        exceptions=answers.exceptions,
        polls=counts.polls,
        failed_polls=counts.failed,
        ranges=tuple(
            RangeStatus(str(poll), milliseconds(poll.every), optional_ms(age)) for poll, age in mirror.ages(now)
        ),
    )


async def virtual_status(unit: VirtualUnit) -> VirtualStatus:
    """Make the status of a virtual unit, with pauses for the lines."""
    sources = await in_slices(source_states(unit, asyncio.get_running_loop().time()))
    settings, answers, counts = unit.settings, unit.answer_counts, unit.counts
    told = tuple(SourceStatus(each.device, each.rows, each.fresh, optional_ms(each.age)) for each in sources)
    return VirtualStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        requests=answers.requests,
        exceptions=answers.exceptions,
        polls=counts.polls,
        failed_polls=counts.failed,
        age_ms=oldest(each.age_ms for each in told),
        sources=told,
    )


def _times(of: Iterable[Times]) -> TimesStatus:
    """Combine the times of several functions. The limit is the longest one."""
    times = tuple(of)
    wait = merged(SECONDS, (each.wait for each in times))
    answer = merged(SECONDS, (each.answer for each in times))
    share = merged(SHARES, (each.share for each in times))
    return TimesStatus(
        wait_p50_ms=optional_ms(wait.quantile(0.5)),
        wait_p99_ms=optional_ms(wait.quantile(0.99)),
        answer_p50_ms=optional_ms(answer.quantile(0.5)),
        answer_p99_ms=optional_ms(answer.quantile(0.99)),
        limit_share_p50=_optional_share(share.quantile(0.5)),
        limit_share_p99=_optional_share(share.quantile(0.99)),
        limit_ms=milliseconds(max((each.limit for each in times), default=0.0)) or None,
        late=sum(each.late for each in times),
    )


def ago_ms(at: float, now: float) -> float | None:
    """Return how long ago it was; None if it never was."""
    return None if at == NEVER else milliseconds(now - at)


def oldest(ages: Iterable[float | None]) -> float | None:
    """Return the oldest age; None if one is not known."""
    known = list(ages)
    return None if None in known else max((age for age in known if age is not None), default=0.0)


def _optional_share(share: float | None) -> float | None:
    return None if share is None else round(share, 3)
