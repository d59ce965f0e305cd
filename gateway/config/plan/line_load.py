"""Who wants what to be polled, what that takes of lines and upstreams, and how often devices can be read."""

from collections.abc import Collection, Iterator, Mapping
from typing import Final, NamedTuple

from gateway.config.plan.forecast import most_items, one_of_each_kind
from gateway.config.plan.settings import LinePlan, MonitorPlan, OwnerPlan, Plan, UpstreamPlan
from gateway.config.values.reserved_names import MQTT
from gateway.devices.device import DeviceSettings
from gateway.errors import RequestError
from gateway.images.polls import Poll, joined
from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import RequestPdu, Span, parse_request
from gateway.ports.port import SerialSettings
from gateway.profiles.holes import Holes
from gateway.profiles.profile import Profile
from gateway.profiles.read_rules import ReadRules
from gateway.registers.items import read_request
from gateway.timing.budget import NETWORK_LATENCY, Pace

#: From this share on a line has little time left for anything but its polls.
FULL: Final = 0.9
#: The registers of a request for which rates are told, beside the most that a device takes.
_USUAL_COUNTS: Final = (1, 10)
#: What devices are read by, the usual area first.
_AREAS: Final = (Area.HOLDING, Area.INPUT, Area.COILS, Area.DISCRETE)


class WantedPoll(NamedTuple):
    """What one point, or one row of the config, wants of the device named `of`. `trace` shows `by` as the client."""

    by: str
    of: str
    poll: Poll
    is_point: bool


def wanted_polls(plan: Plan, devices: Collection[str]) -> Mapping[str, tuple[WantedPoll, ...]]:
    """Find all that mirrors, virtual units and MQTT want to have polled of the devices with these names, by these.

    What is only heard is not polled.
    """
    found: dict[str, list[WantedPoll]] = {}
    for wanted in (*_of_mirrors(plan, devices), *_of_virtual_units(plan, devices), *_of_mqtt(plan, devices)):
        if wanted.poll.every:
            found.setdefault(wanted.of, []).append(wanted)
    return {name: tuple(each) for name, each in found.items()}


def _of_mirrors(plan: Plan, devices: Collection[str]) -> Iterator[WantedPoll]:
    for mirror in plan.mirrors:
        for poll in mirror.wanted if mirror.of in devices else ():
            yield WantedPoll(mirror.label, mirror.of, poll, is_point=False)


def _of_virtual_units(plan: Plan, devices: Collection[str]) -> Iterator[WantedPoll]:
    for unit in plan.virtual:
        for value in unit.values:
            if value.device in devices:
                yield WantedPoll(unit.label, value.device, value.poll, is_point=value.point is not None)


def _of_mqtt(plan: Plan, devices: Collection[str]) -> Iterator[WantedPoll]:
    for device in plan.mqtt.devices if plan.mqtt else ():
        for each in device.points if device.name in devices else ():
            if each.is_readable:
                yield WantedPoll(MQTT, device.name, Poll.of(each.point, each.every), is_point=True)


class DeclaredPoll(NamedTuple):
    """A request that the config declares: the device `of` is sent `poll`, for all that is `wanted` and read with it."""

    of: DeviceSettings
    poll: Poll
    wanted: tuple[WantedPoll, ...]

    @property
    def by(self) -> tuple[str, ...]:
        """The clients that want it."""
        return tuple(dict.fromkeys(each.by for each in self.wanted))


class PollLoad(NamedTuple):
    """A declared poll, the seconds that its line or upstream needs for it, and the share of its time that this is.

    Unless the profile of the device `has_time` for it, they are the least that it can take.
    """

    declared: DeclaredPoll
    time: float
    share: float
    has_time: bool


class ReadRate(NamedTuple):
    """A read of so many `items` of `area` takes the line `time` seconds.

    So it can be repeated `alone` times a second if nothing else is asked, and `in_turn` times if every device of the
    line is read likewise; None where the devices are not known. If the profile of the device `has_time` for it, that
    is part of the time; else the device is assumed to answer at once. Both are None if nothing takes any time: on a
    line without a wire, as far as the config says.
    """

    area: Area
    items: int
    time: float
    alone: float | None
    in_turn: float | None
    has_time: bool


def declared_polls(owner: OwnerPlan, plan: Plan) -> Iterator[DeclaredPoll]:
    """Find every read that is sent to a line or upstream because the config says so: as few as its devices allow."""
    wanted = wanted_polls(plan, {device.name for device in owner.devices})
    for device in owner.devices:
        by_poll: dict[Poll, list[WantedPoll]] = {}
        for each in wanted.get(device.name, ()):
            by_poll.setdefault(each.poll, []).append(each)
        for poll in joined(by_poll, ReadRules.of(device.profile), Holes()):
            yield DeclaredPoll(device, poll, tuple(each for part in poll.wanted for each in by_poll[part]))


def load_of(owner: OwnerPlan, plan: Plan) -> tuple[PollLoad, ...]:
    """Compute what the declared polls take of a line or upstream. If it is more than there is, they come less often.

    Nothing is polled on a monitor line.
    """
    if isinstance(owner, MonitorPlan):
        return ()
    at_once = owner.upstream.in_flight if isinstance(owner, UpstreamPlan) else 1
    found = ((each, time_of(owner, each.of, each.poll.request)) for each in declared_polls(owner, plan))
    return tuple(PollLoad(each, time, time / each.poll.every / at_once, _has_time(each)) for each, time in found)


def total_share(load: tuple[PollLoad, ...]) -> float:
    """Add up the share of a line or upstream that all of its polls take."""
    return sum(each.share for each in load)


def read_rates(line: LinePlan, device: DeviceSettings) -> tuple[ReadRate, ...]:
    """Compute how often a device can be read, for some numbers of items; empty if it cannot be read."""
    area = read_area(device.profile)
    if area is None:
        return ()
    most = most_items(READERS[area][0], device.profile)
    return tuple(_rate(line, device, area, count) for count in (*(c for c in _USUAL_COUNTS if c < most), most))


def time_of(owner: OwnerPlan, device: DeviceSettings, request: bytes) -> float:
    """Compute the seconds that a line or upstream needs for a request to a device."""
    return _pace(owner, device).time_of(_parsed(request, device.profile), device.profile.timing)


def _parsed(request: bytes, profile: Profile) -> RequestPdu:
    """Parse a read; an example that is partly in registers of four bytes, as one of ordinary registers."""
    try:
        return profile.check(request)
    except RequestError:
        return parse_request(request)


def read_area(profile: Profile) -> Area | None:
    """Choose what is read of a device when nothing else is said; None if its profile has no reading function."""
    return next((area for area in _AREAS if profile.knows(READERS[area][0])), None)


def a_read(profile: Profile, count: int) -> Span | None:
    """Choose up to `count` items that exist in a device with this profile; None if nothing of it can be read."""
    area = read_area(profile)
    if area is None:
        return None
    first = min((start for start, _ in profile.areas.get(area, ())), default=0)
    last = max((end for start, end in profile.areas.get(area, ()) if start == first), default=0xFFFF)
    return Span(area, first, min(count, most_items(READERS[area][0], profile), last + 1 - first))


def _rate(line: LinePlan, device: DeviceSettings, area: Area, count: int) -> ReadRate:
    time = _time_of_read(line, device, count)
    round_trip = 0.0 if line.passes_through else _round_trip(line, count)
    has_time = READERS[area][0] in device.profile.timing.rows
    return ReadRate(area, count, time, 1 / time if time else None, 1 / round_trip if round_trip else None, has_time)


def _round_trip(line: LinePlan, count: int) -> float:
    times = {id(each.profile): _time_of_read(line, each, count) for each in one_of_each_kind(line)}
    return sum(times[id(each.profile)] for each in line.devices)


def _time_of_read(line: LinePlan, device: DeviceSettings, count: int) -> float:
    span = a_read(device.profile, count)
    return 0.0 if span is None else time_of(line, device, read_request(span))


def _has_time(declared: DeclaredPoll) -> bool:
    return declared.poll.request[0] in declared.of.profile.timing.rows


def _pace(owner: OwnerPlan, device: DeviceSettings) -> Pace:
    if isinstance(owner, UpstreamPlan):
        return Pace(None, owner.upstream.gap)
    settings, frame_end = owner.line, owner.line.timing.frame_end(device.profile.idle_chars)
    timing = None if settings.wire == "direct" else settings.timing
    return Pace(timing, settings.silence_before_request, frame_end, _usual_latency(owner))


def _usual_latency(line: LinePlan | MonitorPlan) -> float:
    """Give the latency that the config names, else none. An adapter adds a millisecond at most, when it is set well.

    What a network adds is not known if the config does not say it.
    """
    if isinstance(line.port, SerialSettings):
        return (line.port.latency or 0.0) + line.port.driver_delay
    return 0.0 if line.latency == NETWORK_LATENCY else line.latency
