"""What lines and units have done since the last look at their counters; nothing is counted separately for this."""

import asyncio
from collections.abc import Mapping
from operator import attrgetter, sub
from typing import Final, NamedTuple

from gateway.clock.slices import turn
from gateway.devices.device import Device, EveryDevice
from gateway.lines.counts import RESULTS, UNSENT
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.timing.history import LineUse, UnitUse

#: The lines never wait longer for a look than this, in seconds.
_SLICE: Final = 0.0005

_RESULTS: Final = attrgetter(*RESULTS)
_FAILED: Final = attrgetter("bad_frame", "ambiguous", "line_lost")
#: Without those that the gateway answers for the unit (`refused`), and those that are no longer wanted.
_UNSENT: Final = attrgetter(*UNSENT)

_LookedAt = Device | EveryDevice


class _Total(NamedTuple):
    """What a unit has done since its start, and how many requests were sent to it."""

    use: UnitUse
    sent: int


_NOTHING: Final = _Total(UnitUse(), 0)


class Uses(NamedTuple):
    """What lines and units have done, by name."""

    lines: Mapping[str, LineUse]
    units: Mapping[str, UnitUse]


class Look:
    """Compares the counters with those of the last look. Parts that a reload has built begin at 0."""

    def __init__(self) -> None:
        self._at = asyncio.get_running_loop().time()
        self._units: dict[_LookedAt, _Total] = {}
        self._busy: dict[Owner, float] = {}

    async def take(self, gateway: Gateway) -> Uses:
        """Return what lines and units have done since the last look, with pauses in which lines work."""
        now = asyncio.get_running_loop().time
        seconds, self._at = now() - self._at, now()
        lines: dict[str, LineUse] = {}
        units: dict[str, UnitUse] = {}
        totals: dict[_LookedAt, _Total] = {}
        busy: dict[Owner, float] = {}
        until = now() + _SLICE
        for part in gateway.owners:
            sent = failed = 0
            for device in _devices(part):
                if now() >= until:
                    await turn()
                    until = now() + _SLICE
                totals[device] = total = _total(device)
                before = self._units.get(device, _NOTHING)
                resting = seconds if device.breaker.is_resting(now()) else 0.0
                sent += total.sent - before.sent
                failed += total.use.timeouts + total.use.failed - before.use.timeouts - before.use.failed
                if isinstance(device, Device) and (resting or total != before):
                    units[device.name] = UnitUse(*map(sub, total.use, before.use))._replace(resting=resting)
            busy[part] = part.busy(now())
            more = max(0.0, busy[part] - self._busy.get(part, 0.0))
            lines[part.name] = LineUse(seconds, more, 0.0 if part.reconnector.is_open else seconds, sent, failed)
        self._units, self._busy = totals, busy
        return Uses(lines, units)


def _devices(part: Owner) -> list[_LookedAt]:
    all_of_them = [part.every_device] if isinstance(part, GatewayLine) else []
    return [*all_of_them, *part.all_devices]


def _total(device: _LookedAt) -> _Total:
    total = _NOTHING
    for function, counts in device.counts.items():
        times = device.counts.times[function]
        use = UnitUse(
            requests=sum(_RESULTS(counts)),
            timeouts=counts.timeout,
            failed=sum(_FAILED(counts)),
            unsent=sum(_UNSENT(counts)),
            exceptions=counts.exception,
            responses=counts.responses,
            answer=times.answer.total,
            share=times.share.total,
        )
        total = _Total(total.use.plus(use), total.sent + counts.sent)
    return total
