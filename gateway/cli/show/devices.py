"""The devices of a line or upstream, as `check` shows them: units, longest waits, time limits, as `profile` does."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any, Final

from gateway.cli.kit.columns import align, without_middles
from gateway.config.plan.forecast import FunctionLimits, function_limits, owed_after_waking
from gateway.config.plan.settings import LinePlan, OwnerPlan, Plan
from gateway.config.problem import listed
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_unit, show_units
from gateway.devices.device import DeviceSettings
from gateway.lines.settings import LineSettings
from gateway.upstreams.settings import UpstreamSettings

#: So many devices without a unit are named beside limits that they share, or that sleep.
_MOST_NAMED: Final = 3


def limits_table(limits: tuple[FunctionLimits, ...], indent: str) -> str:
    """Show the limits of each function as a table."""
    rows = [
        (
            "others" if one.function is None else str(one.function),
            show_duration(one.one_item),
            str(one.most) if one.most else "-",
            show_duration(one.most_items),
        )
        for one in limits
    ]
    return align([("FUNCTION", "LIMIT FOR 1 ITEM", "MOST ITEMS", "LIMIT FOR MOST"), *rows], indent)


def limits_as_json(limits: tuple[FunctionLimits, ...]) -> list[dict[str, Any]]:
    """Make the limits of each function for programs; `function` is None for all others."""
    return [
        {
            "function": one.function,
            "one_item_ms": milliseconds(one.one_item),
            "most_items": one.most,
            "most_items_ms": milliseconds(one.most_items),
        }
        for one in limits
    ]


def round_up(seconds: float) -> str:
    """Show a time, rounded up to the three digits that are shown."""
    if not seconds:
        return "at once"
    step = max(0.01, 10.0 ** (floor(log10(seconds)) - 2))
    return show_duration(ceil(seconds / step) * step)


def milliseconds(seconds: float) -> float:
    """Turn a time into that of JSON output."""
    return round(seconds * 1000, 3)


@dataclass(frozen=True, slots=True)
class ShownDevice:
    """A device, or all units of a line that passes them through."""

    units: str
    wire_units: str
    device: DeviceSettings
    limits: tuple[FunctionLimits, ...]
    longest_wait: float

    @property
    def device_name(self) -> str:
        """The name of the device, or what stands for those of all units."""
        return self.device.name if self.units == show_unit(self.device.client_unit) else "(each)"


def shown_devices(plan: OwnerPlan, devices: Iterable[DeviceSettings], waits: Mapping[str, float]) -> list[ShownDevice]:
    """List devices of a line or upstream, each for itself; `waits` are the longest ones, by name."""
    return [_shown(plan, each, show_unit(each.client_unit), str(each.unit), waits) for each in devices]


def all_alike(plan: LinePlan, units: str, waits: Mapping[str, float]) -> ShownDevice:
    """Make the row of a line that passes these units through."""
    return _shown(plan, plan.devices[0], units, "same", waits)


def _shown(
    plan: OwnerPlan, device: DeviceSettings, units: str, wire_units: str, waits: Mapping[str, float]
) -> ShownDevice:
    limits = function_limits(device.profile, device.answer_time, plan.budget)
    return ShownDevice(units, wire_units, device, limits, waits[device.name])


def devices_table(devices: Iterable[ShownDevice], place: str, writers: Mapping[str, Sequence[str]]) -> str:
    """Show devices as a table; `place` is the heading of their units on the wire, or behind the server.

    `writers` are the other units through which a device can be written, by its name.
    """
    rows = [
        (
            one.units,
            one.wire_units,
            one.device_name,
            one.device.profile.name,
            round_up(one.longest_wait),
            ", ".join(writers.get(one.device_name, ())),
        )
        for one in devices
    ]
    headings = ("UNIT", place, "DEVICE", "PROFILE", "LONGEST WAIT", "WRITTEN THROUGH, TOO")
    shown = len(headings) if any(row[-1] for row in rows) else len(headings) - 1
    return align([headings[:shown], *without_middles([row[:shown] for row in rows], (0, 1, 2))], "  ")


def units_that_write(plan: Plan) -> dict[str, list[str]]:
    """List the mirrors and virtual units through which each device can be written, by its name."""
    found: dict[str, list[str]] = {}
    for mirror in plan.mirrors:
        found.setdefault(mirror.of, []).append(f"{mirror.unit} {mirror.name}")
    for unit in plan.virtual:
        for name in dict.fromkeys(value.device for value in unit.values if value.write):
            found.setdefault(name, []).append(f"{unit.unit} {unit.name}")
    return found


def writers_of_each(devices: Iterable[DeviceSettings], writers: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Say it of the devices of a line that passes all units through, which have one row for all."""
    for device in devices:
        if device.name in writers:
            yield f"  {device.name} is written through {', '.join(writers[device.name])}, too."


def one_of_each_kind(devices: Iterable[ShownDevice]) -> Iterator[tuple[ShownDevice, str]]:
    """Choose a device for each profile and its limits, and name the units for which it stands."""
    alike: dict[tuple[str, tuple[FunctionLimits, ...]], list[ShownDevice]] = {}
    for one in devices:
        alike.setdefault((one.device.profile.name, one.limits), []).append(one)
    yield from ((same[0], f"{name}, {_name_units(same)}") for (name, _), same in alike.items())


def limits_as_text(one: ShownDevice, of: str) -> str:
    """Show the limits of a device: in one line if all functions have the same."""
    limits = {each for row in one.limits for each in (row.one_item, row.most_items)}
    if len(limits) == 1:
        return f"  Time limit of {of}: {show_duration(limits.pop())}"
    return f"  Time limits of {of}\n{limits_table(one.limits, '    ')}"


def failures_as_text(settings: LineSettings | UpstreamSettings, retry_within: str = "") -> Iterator[str]:
    """Say what happens after a failure, where that is not the default."""
    if settings.retries:
        yield f"  retries {settings.retries}{retry_within}"
    if settings.rest is not None:
        yield f"  rest {show_duration(settings.rest) if settings.rest else 'off'}"


def wakes_as_text(plan: OwnerPlan) -> Iterator[str]:
    """Say which devices sleep, and what that means for the read after the first one."""
    names: dict[tuple[float, float], list[str]] = {}
    for device in plan.devices:
        if device.wake:
            owed = owed_after_waking(plan, device) if isinstance(plan, LinePlan) else 0.0
            names.setdefault((device.wake, owed), []).append(device.name)
    for (wake, owed), alike in names.items():
        sleeps, its = ("sleep", "their") if len(alike) > 1 else ("sleeps", "its")
        what = f"after {show_duration(wake)} without a request {its} first read is sent twice"
        yield f"  {listed(alike)} {sleeps}: {what}."
        if isinstance(plan, LinePlan) and owed:
            fate = "waits" if owed <= plan.line.max_wait else "gets 0B, because max_wait is shorter"
            yield f"  The other answer may come for {round_up(owed)}; until then, a read with that function {fate}."


def device_as_json(one: ShownDevice, writers: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Make a device for programs, but for its unit on the wire; `writers` as for the table."""
    return {
        "unit": None if one.device.client_unit is None else one.units,
        "device": one.device_name,
        "profile": one.device.profile.name,
        "longest_wait_ms": milliseconds(one.longest_wait),
        "written_through": list(writers.get(one.device_name, ())),
        "limits": limits_as_json(one.limits),
    }


def _name_units(devices: list[ShownDevice]) -> str:
    if len(devices) == 1 and devices[0].device.client_unit is not None:
        text = devices[0].units
    else:
        text = show_units(one.device.client_unit for one in devices if one.device.client_unit is not None)
    named = [one.device.name for one in devices if one.device.client_unit is None]
    numbers = [f"unit{'' if text.isdecimal() else 's'} {text}"] if text else []
    return ", ".join([*numbers, *named[:_MOST_NAMED], *(["..."] if len(named) > _MOST_NAMED else [])])
