"""Watches for devices whose response times are near their limits: the next slow one is a time-out."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf
from typing import Final

from gateway.devices.device import Device
from gateway.events import Emit, TimingTight
from gateway.runtime.gateway import Gateway, Owner
from gateway.timing.histogram import SHARES, Histogram
from gateway.timing.measured import Times

#: How often response times are checked, in seconds, and how many responses are needed for that.
STEP: Final = 60.0
ENOUGH: Final = 100
#: If 1 of 100 responses takes this share of the limit or more, it is reported.
TIGHT: Final = 0.8
#: How long a function of a device is not reported again, in seconds.
PAUSE: Final = 3600.0


@dataclass(slots=True)
class _Seen:
    """The counters at the last check, and the time of the last report."""

    times: Times
    counts: list[int]
    told_at: float = -inf


class TightLimits:
    """Compares the responses since the last check with their limits."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str, int], _Seen] = {}

    async def keep_looking(self, gateway: Callable[[], Gateway], emit: Emit) -> None:
        """Report tight limits until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(STEP)
            for event in self.look(gateway(), loop.time()):
                emit(event)

    def look(self, gateway: Gateway, now: float) -> list[TimingTight]:
        """Find what to report at `now`."""
        before, self._seen = self._seen, {}
        return [event for line, device in _devices(gateway) for event in self._tight(line, device, before, now)]

    def _tight(
        self, line: Owner, device: Device, before: dict[tuple[str, str, int], _Seen], now: float
    ) -> Iterator[TimingTight]:
        for function, times in device.counts.times.items():
            key = (line.name, device.name, function)
            seen = before.get(key)
            if seen is None or seen.times is not times:
                seen = _Seen(times, [0] * len(times.share.counts))
            self._seen[key] = seen
            recent = Histogram(SHARES)
            recent.counts = [count - old for count, old in zip(times.share.counts, seen.counts, strict=True)]
            if sum(recent.counts) < ENOUGH:
                continue
            seen.counts = list(times.share.counts)
            share = recent.quantile(0.99) or 0.0
            if share >= TIGHT and now - seen.told_at >= PAUSE:
                seen.told_at = now
                yield _event(line, device, function, share, times.limit)


def _devices(gateway: Gateway) -> Iterator[tuple[Owner, Device]]:
    return ((owner, device) for owner in gateway.owners for device in owner.all_devices)


def _event(line: Owner, device: Device, function: int, share: float, limit: float) -> TimingTight:
    return TimingTight(
        line=line.name,
        unit=device.unit,
        device=device.name,
        function=function,
        elapsed_ms=round(share * limit * 1000, 1),
        limit_ms=round(limit * 1000, 1),
        source=device.source,
        advice=f"modbus-gateway calibrate {device.name} shows which limit it needs",
    )
