"""The metrics of a gateway, read from its counters at each scrape.

Labels are names in the config, units, function codes and words of this program, never data or names of clients.
"""

import asyncio
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from itertools import accumulate
from operator import add, attrgetter
from typing import Final

from gateway.clock.slices import in_slices
from gateway.devices.device import Device
from gateway.lines.counts import OTHER_FUNCTIONS, RESULTS, UnitCounts
from gateway.observe.families import Family, Spread
from gateway.operator.operations.answers.status import HeardCounts
from gateway.operator.status.unit_status import oldest
from gateway.operator.status.virtual_sources import source_states
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.running import Running
from gateway.timing.histogram import Histogram
from gateway.tls.store import TlsStore
from gateway.version import __version__

#: The bucket bounds that are exported, of those that are counted.
_SECONDS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_SHARES: Final = (0.25, 0.5, 0.75, 0.8, 0.9, 1.0)
#: Results that are exported from the first request on, so that their first increase is visible; others once they occur.
_ALWAYS: Final = frozenset({"ok", "exception", "timeout", "bad_frame"})
#: What was received on a line besides responses.
_ERRORS: Final = ("late_responses", "early_responses", "foreign_frames", "noise", "echoes")
_ERRORS_OF: Final = attrgetter(*_ERRORS)

_UNIT: Final = ("line", "unit", "function")


async def read(running: Running) -> list[Family]:
    """Read all metrics of the running gateway, with pauses for its lines; each unit is read in its turn."""
    now = asyncio.get_running_loop().time
    for each in running.add_ons:
        await each.look()
    gateway = running.gateway
    requests, times, units, images = _Requests(), _Times(), _Units(), _Images()
    await in_slices(part for each in (requests, times, units) for owner in gateway.owners for part in each.read(owner))
    await in_slices(images.read(gateway))
    requests.read_routers(running)
    return [
        *requests.families,
        *times.families,
        *_lines(gateway, now()),
        *units.families,
        *_clients(running),
        *images.families,
        _upstreams(gateway.upstreams),
        *_heard(gateway.monitors),
        _certificates(running.contexts),
        *(family for each in running.add_ons for family in each.metrics()),
        *_process(running),
    ]


class _Requests:
    """Metrics of client requests by result."""

    def __init__(self) -> None:
        self._results = Family("counter", "requests", "Requests of clients by result.", (*_UNIT, "result"))
        self._exceptions = Family("counter", "exceptions", "Exception responses of units.", ("line", "unit", "code"))
        self._coalesced = Family("counter", "coalesced", "Reads that shared a transaction with another one.", ("line",))
        self._retries = Family("counter", "retries", "Reads that were repeated.", ("line",))
        self._errors = Family(
            "counter", "line_errors", "What was received besides the expected responses.", ("line", "kind")
        )
        self.families = (self._results, self._exceptions, self._coalesced, self._retries, self._errors)

    def read(self, owner: Owner) -> Iterator[None]:
        """Add the counts of a line or upstream, one unit at a time."""
        coalesced = retries = 0
        errors = [0] * len(_ERRORS)
        for unit, counts in _counted(owner):
            for function, each in counts.items():
                coalesced, retries = coalesced + each.coalesced, retries + each.retries
                errors = [*map(add, errors, _ERRORS_OF(each))]
                for result in RESULTS:
                    count = getattr(each, result)
                    if count or result in _ALWAYS:
                        self._results.add(count, owner.name, unit, _function(function), result)
            for code, count in counts.codes.items():
                self._exceptions.add(count, owner.name, unit, f"{code:02X}")
            yield
        self._coalesced.add(coalesced, owner.name)
        self._retries.add(retries, owner.name)
        if isinstance(owner, GatewayLine):
            for kind, count in zip(_ERRORS, errors, strict=True):
                self._errors.add(count, owner.name, kind)

    def read_routers(self, running: Running) -> None:
        """Add the requests that reached no unit."""
        routers = [each.router.counts for each in (*running.gateway.listeners, *running.gateway.servers)]
        self._results.add(sum(each.no_route for each in routers), "", "", "", "no_route")
        self._results.add(sum(each.denied for each in routers), "", "", "", "denied")


class _Times:
    """Metrics of the times of requests, and of the shares of their limits."""

    def __init__(self) -> None:
        self._request = _histogram("request_duration_seconds", "From a request's arrival to its response.")
        self._answer = _histogram("device_response_seconds", "From the end of a request to the end of its response.")
        self._wait = _histogram("queue_wait_seconds", "From a request's arrival until it was sent.")
        self._share = _histogram("budget_used_ratio", "The share of its time limit that a response took.")
        self.families = (self._request, self._answer, self._wait, self._share)

    def read(self, owner: Owner) -> Iterator[None]:
        """Add the times of a line or upstream, one unit at a time."""
        for unit, counts in _counted(owner):
            for function in counts:
                labels, times = (owner.name, unit, _function(function)), counts.times[function]
                self._request.add(_spread(times.request, _SECONDS), *labels)
                self._answer.add(_spread(times.answer, _SECONDS), *labels)
                self._wait.add(_spread(times.wait, _SECONDS), *labels)
                self._share.add(_spread(times.share, _SHARES), *labels)
            yield


def _histogram(name: str, text: str) -> Family:
    return Family("histogram", name, text, _UNIT)


def _lines(gateway: Gateway, now: float) -> Iterable[Family]:
    busy = Family("counter", "line_busy_seconds", "Time of a line by phase.", ("line", "phase"))
    waiting = Family("gauge", "line_queue_length", "Requests that wait for the line.", ("line",))
    up = Family("gauge", "line_up", "Whether the port is open.", ("line",))
    reopens = Family("counter", "line_reopens", "How often the port was reopened after a loss.", ("line",))
    held = Family("gauge", "lease_held", "Whether this gateway holds the lease of the line.", ("line", "lease"))
    taken = Family("counter", "lease_taken", "How often it took the lease.", ("line", "lease"))
    for line in gateway.lines:
        phases = line.driver.line.phases(now)
        for phase in ("request", "wait", "response", "gap"):
            busy.add(getattr(phases, phase), line.name, phase)
        waiting.add(len(line.driver.line.queue), line.name)
        if line.standby is not None:
            held.add(line.standby.lease.is_held, line.name, line.standby.name)
            taken.add(line.standby.taken, line.name, line.standby.name)
    on_ports: tuple[GatewayLine | GatewayMonitor, ...] = (*gateway.lines, *gateway.monitors)
    for part in on_ports:
        up.add(part.reconnector.is_open, part.name)
        reopens.add(part.reconnector.reopened, part.name)
    return busy, waiting, up, reopens, *(each for each in (held, taken) if each.values)


class _Units:
    """Metrics of units: whether they respond, and their longest limits."""

    def __init__(self) -> None:
        self._up = Family("gauge", "unit_up", "Whether the unit answered last, and its line is up.", ("line", "unit"))
        self._limit = Family(
            "gauge", "unit_timeout_limit_seconds", "The longest time limit in force.", ("line", "unit")
        )
        self.families = (self._up, self._limit)

    def read(self, owner: Owner) -> Iterator[None]:
        """Add the units of a line or upstream that were asked, one at a time; none of those that others ask."""
        if isinstance(owner, GatewayMonitor):
            return
        now = asyncio.get_running_loop().time
        for unit, device in _asked(owner):
            is_up = owner.reconnector.error is None
            is_up = is_up and not device.breaker.failures and not device.breaker.is_resting(now())
            self._up.add(is_up, owner.name, unit)
            self._limit.add(max(each.limit for each in device.counts.times.values()), owner.name, unit)
            yield


def _clients(running: Running) -> Iterable[Family]:
    clients = Family("gauge", "clients", "Clients that are connected.", ("listener",))
    rejected = Family("counter", "client_rejected", "Clients that were rejected or closed.", ("listener",))
    for listener in running.gateway.listeners:
        clients.add(listener.clients, listener.settings.name)
        rejected.add(listener.counts.rejected, listener.settings.name)
    return clients, rejected


class _Images:
    """Metrics of mirrors and virtual units: how old their values are, and how many sources are fresh."""

    def __init__(self) -> None:
        self._ages = Family(
            "gauge", "image_age_seconds", "Age of the oldest values of a mirror or virtual unit.", ("unit",)
        )
        self._sources = Family("gauge", "image_sources", "Sources of a virtual unit by state.", ("unit", "state"))
        self.families = (self._ages, self._sources)

    def read(self, gateway: Gateway) -> Iterator[None]:
        """Add the mirrors, and the virtual units one source at a time. One with unknown values has no age."""
        now = asyncio.get_running_loop().time
        for mirror in gateway.mirrors:
            self._add_age(mirror.unit.settings.unit, [age for _, age in mirror.unit.ages(now())])
            yield
        for virtual in gateway.virtual:
            states = []
            for each in source_states(virtual.unit, now()):
                states.append(each)
                yield
            unit, fresh = virtual.unit.settings.unit, sum(each.fresh == each.rows for each in states)
            self._add_age(unit, [each.age for each in states])
            self._sources.add(fresh, str(unit), "fresh")
            self._sources.add(len(states) - fresh, str(unit), "stale")

    def _add_age(self, unit: int, ages: Sequence[float | None]) -> None:
        age = oldest(ages)
        if age is not None:
            self._ages.add(age, str(unit))


def _upstreams(upstreams: Iterable[GatewayUpstream]) -> Family:
    up = Family("gauge", "upstream_up", "Whether there is a connection.", ("upstream",))
    for upstream in upstreams:
        up.add(upstream.reconnector.is_open, upstream.name)
    return up


def _heard(monitors: Iterable[GatewayMonitor]) -> Iterable[Family]:
    """Count what is heard on lines where the gateway only listens, if there are any."""
    heard = Family("counter", "heard", "What was heard on a line that only listens, by kind.", ("line", "kind"))
    for monitor in monitors:
        for kind in fields(HeardCounts):
            heard.add(getattr(monitor.driver.monitor.counts, kind.name), monitor.name, kind.name)
    return (heard,) if heard.values else ()


def _certificates(contexts: TlsStore) -> Family:
    """Find the earliest expiry of each kind: a file may have several certificates."""
    ends = Family(
        "gauge", "certificate_expiry_timestamp_seconds", "Until when certificates are valid.", ("used_by", "key")
    )
    first: dict[tuple[str, str], float] = {}
    for secured, expiry in contexts.expiries():
        place = secured.name, expiry.what
        first[place] = min(first.get(place, expiry.at), expiry.at)
    for place, at in first.items():
        ends.add(at, *place)
    return ends


def _process(running: Running) -> Iterable[Family]:
    lag = Family("gauge", "loop_lag_seconds", "The largest delay of the event loop in the last minute.")
    lag.add(running.recent.loop_lag)
    reload = Family("gauge", "config_last_reload_successful", "Whether the config was accepted when it was last read.")
    reload.add(running.reload_succeeded)
    build = Family("gauge", "build_info", "1, with the version.", ("version",))
    build.add(1, __version__)
    return lag, reload, build


def _asked(owner: Owner) -> list[tuple[str, Device]]:
    """List the units that were asked, by their numbers for clients; by name without one, or if it is another unit's."""
    asked = [(device, device.settings.client_unit) for device in owner.all_devices if device.counts]
    return [
        (each.name if unit is None or owner.devices.get(unit, each) is not each else str(unit), each)
        for each, unit in asked
    ]


def _counted(owner: Owner) -> list[tuple[str, UnitCounts]]:
    """List the counters by unit; broadcasts are unit 0."""
    units = [(unit, device.counts) for unit, device in _asked(owner)]
    return [("0", owner.every_device.counts), *units] if isinstance(owner, GatewayLine) else units


def _function(function: int) -> str:
    return "other" if function == OTHER_FUNCTIONS else str(function)


def _spread(histogram: Histogram, bounds: tuple[float, ...]) -> Spread:
    up_to = dict(zip(histogram.scale.bounds, accumulate(histogram.counts), strict=False))
    return Spread([(bound, up_to[bound]) for bound in bounds], sum(histogram.counts), histogram.total)
