"""The lines of a config and their units, as `check` shows them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.show.limits import limits_as_json, limits_table, milliseconds, round_up
from gateway.cli.show.line_load import polls_as_json, polls_as_text, rates_as_json, rates_as_text
from gateway.cli.show.listeners import listeners_for, through
from gateway.config.machine.port_trouble import predict_wire
from gateway.config.plan.forecast import (
    FunctionLimits,
    function_limits,
    longest_wait,
    times_for_repeats,
)
from gateway.config.plan.line_load import load_of, read_rates, total_share
from gateway.config.plan.settings import LinePlan, Plan
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_unit, show_units
from gateway.devices.device import DeviceSettings

#: So many devices without a unit are named beside limits that they share.
_MOST_NAMED: Final = 3


@dataclass(frozen=True, slots=True)
class _Unit:
    """A unit of a line, or all units of a line that passes them through."""

    units: str
    wire_units: str
    device: DeviceSettings
    limits: tuple[FunctionLimits, ...]
    longest_wait: float

    @property
    def device_name(self) -> str:
        return self.device.name if self.units == show_unit(self.device.client_unit) else "(each)"


def _units(plan: LinePlan, whole: Plan) -> list[_Unit]:
    """List the units of a line; for passed-through units, without those that a mirror hides."""
    if plan.passes_through:
        mirrors = {mirror.unit for mirror in whole.mirrors}
        shared = [device for device in plan.shared if device.known_as not in mirrors]
        units = show_units(device.known_as for device in (shared if plan.shared else plan.devices))
        return [_unit(plan, plan.devices[0], units, "same")] if units else []
    return [_unit(plan, device, show_unit(device.client_unit), str(device.unit)) for device in plan.devices]


def _unit(plan: LinePlan, device: DeviceSettings, units: str, wire_units: str) -> _Unit:
    limits = function_limits(device.profile, device.answer_time, plan.line.timing, plan.latency)
    return _Unit(units, wire_units, device, limits, longest_wait(plan, device))


def line_as_text(plan: LinePlan, whole: Plan) -> str:
    """Show a line with its units, their time limits, and what its polls take of it."""
    timing, wire = plan.line.timing, predict_wire(plan.line.wire, plan.port)
    units = _units(plan, whole)
    return "\n".join(
        [
            f"Line {plan.line.name}: {plan.port.port}",
            f"  {timing.mode} {timing.baud} {timing.format}, gap {_gap(plan)}, latency {_latency(plan)}, wire {wire}",
            *_failures(plan),
            align([("UNIT", "ON THE WIRE", "DEVICE", "PROFILE", "LONGEST WAIT"), *map(_row, units)], "  "),
            *_list_listeners(plan, whole),
            *polls_as_text(plan, whole),
            *_limits(units, plan),
        ]
    )


def _failures(plan: LinePlan) -> Iterator[str]:
    """Say what happens after a failure, where that is not the default."""
    line = plan.line
    if line.retries:
        yield f"  retries {line.retries}, retry_within {_retry_within(plan)}"
    if line.rest is not None:
        yield f"  rest {show_duration(line.rest) if line.rest else 'off'}"


def _retry_within(plan: LinePlan) -> str:
    """Show how long a read may take with its repeats."""
    if plan.line.retry_within is not None:
        return show_duration(plan.line.retry_within)
    least, most = map(show_duration, times_for_repeats(plan))
    return f"auto: {least}" if least == most else f"auto: {least} to {most}, by the size of the read"


def _list_listeners(plan: LinePlan, whole: Plan) -> Iterator[str]:
    """List the addresses that the listeners for this line lead to."""
    names = through(listeners_for(plan.line.name, whole), is_shared=_is_shared(plan))
    if names:
        yield f"{names}: {show_units(plan.addresses)}, as on the wire."


def show_silence(seconds: float) -> str:
    """Show a silence between frames."""
    return show_duration(seconds) if seconds else "none"


def _is_shared(plan: LinePlan) -> bool:
    """Tell whether other listeners lead to any of its devices too."""
    return any(device.client_unit is not None for device in plan.shared)


def _gap(plan: LinePlan) -> str:
    return show_silence(plan.line.silence_before_request)


def _latency(plan: LinePlan) -> str:
    return show_duration(plan.latency) + (" (USB: up to 20 ms)" if plan.port.latency is None else "")


def _row(unit: _Unit) -> tuple[str, ...]:
    return unit.units, unit.wire_units, unit.device_name, unit.device.profile.name, round_up(unit.longest_wait)


def _limits(units: list[_Unit], plan: LinePlan) -> Iterator[str]:
    """Show for each kind of device on the line its time limits, and how often it can be read."""
    alike: dict[tuple[str, tuple[FunctionLimits, ...]], list[_Unit]] = {}
    for unit in units:
        alike.setdefault((unit.device.profile.name, unit.limits), []).append(unit)
    for (name, limits), same in alike.items():
        yield f"  Time limits of {name}, {_name_units(same)}\n{limits_table(limits, '    ')}"
        yield from rates_as_text(read_rates(plan, same[0].device), f"{name}, {_name_units(same)}")


def _name_units(units: list[_Unit]) -> str:
    if len(units) == 1 and units[0].device.client_unit is not None:
        text = units[0].units
    else:
        text = show_units(each.device.client_unit for each in units if each.device.client_unit is not None)
    named = [each.device.name for each in units if each.device.client_unit is None]
    numbers = [f"unit{'' if text.isdecimal() else 's'} {text}"] if text else []
    return ", ".join([*numbers, *named[:_MOST_NAMED], *(["..."] if len(named) > _MOST_NAMED else [])])


def line_as_json(plan: LinePlan, whole: Plan) -> dict[str, Any]:
    """Make the same for programs."""
    timing, load = plan.line.timing, load_of(plan, whole)
    return {
        "name": plan.line.name,
        "port": plan.port.port,
        "mode": timing.mode,
        "baud": timing.baud,
        "format": str(timing.format),
        "gap_ms": milliseconds(plan.line.silence_before_request),
        "turnaround_ms": milliseconds(plan.line.turnaround),
        "latency_ms": milliseconds(plan.latency),
        "wire": predict_wire(plan.line.wire, plan.port),
        "retries": plan.line.retries,
        "retry_within_ms": None if plan.line.retry_within is None else milliseconds(plan.line.retry_within),
        "rest_ms": None if plan.line.rest is None else milliseconds(plan.line.rest),
        "passes_through": plan.passes_through,
        "shared": _is_shared(plan),
        "own_listeners": listeners_for(plan.line.name, whole),
        "addresses": show_units(plan.addresses),
        "polls": polls_as_json(load),
        "polls_share": round(total_share(load), 4),
        "units": [_unit_as_json(unit, plan) for unit in _units(plan, whole)],
    }


def _unit_as_json(unit: _Unit, plan: LinePlan) -> dict[str, Any]:
    return {
        "unit": None if unit.device.client_unit is None else unit.units,
        "on_the_wire": unit.wire_units,
        "device": unit.device_name,
        "profile": unit.device.profile.name,
        "longest_wait_ms": milliseconds(unit.longest_wait),
        "limits": limits_as_json(unit.limits),
        "reads": rates_as_json(read_rates(plan, unit.device)),
    }
