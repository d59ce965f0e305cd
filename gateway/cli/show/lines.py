"""The lines of a config and their units, as `check` shows them: those where the gateway asks, or only listens."""

from collections.abc import Iterator
from typing import Any

from gateway.cli.kit.columns import align
from gateway.cli.show.devices import (
    ShownDevice,
    all_alike,
    device_as_json,
    devices_table,
    failures_as_text,
    limits_as_text,
    milliseconds,
    one_of_each_kind,
    round_up,
    shown_devices,
    units_that_write,
    wakes_as_text,
    writers_of_each,
)
from gateway.cli.show.line_load import polls_as_json, polls_as_text, rates_as_json, rates_as_text
from gateway.cli.show.listeners import listeners_for, through
from gateway.config.machine.troubles import predict_wire
from gateway.config.plan.forecast import heard_window, longest_waits, times_for_repeats
from gateway.config.plan.line_load import load_of, read_rates, total_share
from gateway.config.plan.settings import LinePlan, MonitorPlan, Plan
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_unit, show_units
from gateway.devices.device import DeviceSettings


def _devices(plan: LinePlan, whole: Plan) -> list[ShownDevice]:
    """List the devices of a line; for passed-through units, without those that a mirror hides."""
    waits = longest_waits(plan)
    if not plan.passes_through:
        return shown_devices(plan, plan.devices, waits)
    mirrors = {mirror.unit for mirror in whole.mirrors}
    shared = [device for device in plan.shared if device.known_as not in mirrors]
    units = show_units(device.known_as for device in (shared if plan.shared else plan.devices))
    return [all_alike(plan, units, waits)] if units else []


def line_as_text(plan: LinePlan, whole: Plan) -> str:
    """Show a line with its units, their time limits, and what its polls take of it."""
    timing, wire = plan.line.timing, predict_wire(plan.line.wire, plan.port)
    devices, writers = _devices(plan, whole), units_that_write(whole)
    return "\n".join(
        [
            f"Line {plan.line.name}: {plan.port.port}",
            f"  {timing.mode} {timing.baud} {timing.format}, gap {_gap(plan)}, latency {_latency(plan)}, wire {wire}",
            *failures_as_text(plan.line, _retry_within(plan)),
            devices_table(devices, "ON THE WIRE", writers),
            *(writers_of_each(plan.devices, writers) if plan.passes_through else ()),
            *_list_listeners(plan, whole),
            *wakes_as_text(plan),
            *polls_as_text(plan, whole),
            *_limits(devices, plan),
        ]
    )


def _retry_within(plan: LinePlan) -> str:
    """Show how long a read may take with its repeats."""
    if plan.line.retry_within is not None:
        return f", retry_within {show_duration(plan.line.retry_within)}"
    least, most = map(show_duration, times_for_repeats(plan))
    return f", retry_within auto: {least}" + ("" if least == most else f" to {most}, by the size of the read")


def _is_shared(plan: LinePlan) -> bool:
    """Tell whether other listeners lead to any of its devices too."""
    return any(device.client_unit is not None for device in plan.shared)


def _list_listeners(plan: LinePlan, whole: Plan) -> Iterator[str]:
    """List the addresses that the listeners for this line lead to."""
    names = through(listeners_for(plan.line.name, whole), is_shared=_is_shared(plan))
    if names:
        yield f"{names}: {show_units(plan.addresses)}, as on the wire."


def show_silence(seconds: float) -> str:
    """Show a silence between frames."""
    return show_duration(seconds) if seconds else "none"


def _gap(plan: LinePlan) -> str:
    return show_silence(plan.line.silence_before_request)


def _latency(plan: LinePlan) -> str:
    return show_duration(plan.latency) + (" (USB: up to 20 ms)" if plan.port.latency is None else "")


def _limits(devices: list[ShownDevice], plan: LinePlan) -> Iterator[str]:
    """Show for each kind of device on the line its time limits, and how often it can be read."""
    for one, of in one_of_each_kind(devices):
        yield limits_as_text(one, of)
        yield from rates_as_text(read_rates(plan, one.device), of)


def line_as_json(plan: LinePlan, whole: Plan) -> dict[str, Any]:
    """Make the same for programs."""
    timing, load, writers = plan.line.timing, load_of(plan, whole), units_that_write(whole)
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
        "units": [
            {
                "on_the_wire": one.wire_units,
                **device_as_json(one, writers),
                "reads": rates_as_json(read_rates(plan, one.device)),
            }
            for one in _devices(plan, whole)
        ],
    }


def monitor_as_text(monitor: MonitorPlan, plan: Plan) -> str:
    """Show a line that only listens, and where the values of its devices go."""
    timing, wire = monitor.line.timing, predict_wire(monitor.line.wire, monitor.port)
    rows = [
        (
            show_unit(each.client_unit),
            str(each.unit),
            each.name,
            each.profile.name,
            round_up(heard_window(monitor, each)),
            ", ".join(_readers(each, plan)) or "none",
        )
        for each in monitor.devices
    ]
    head = ("UNIT", "ON THE WIRE", "DEVICE", "PROFILE", "LATE WINDOW", "READ THROUGH")
    table = [
        align([head, *rows], "  "),
        "  Requests to these units are answered with 0A: clients read the mirrors and virtual units.",
        "  An answer is a value if no earlier request of its unit and function lacks one for less than the window.",
    ]
    return "\n".join(
        [
            f"Monitor line {monitor.name}: {monitor.port.port}",
            f"  {timing.mode} {timing.baud} {timing.format}, wire {wire}; only listens: nothing is ever sent there",
            *(table if rows else ["  no devices: the trace shows what is heard, and there are no values"]),
        ]
    )


def monitor_as_json(monitor: MonitorPlan, plan: Plan) -> dict[str, Any]:
    """Make the same for programs."""
    timing = monitor.line.timing
    return {
        "name": monitor.name,
        "port": monitor.port.port,
        "mode": timing.mode,
        "baud": timing.baud,
        "format": str(timing.format),
        "wire": predict_wire(monitor.line.wire, monitor.port),
        "units": [
            {
                "unit": each.client_unit,
                "on_the_wire": each.unit,
                "device": each.name,
                "profile": each.profile.name,
                "late_window_ms": milliseconds(heard_window(monitor, each)),
                "read_through": _readers(each, plan),
            }
            for each in monitor.devices
        ],
    }


def _readers(device: DeviceSettings, plan: Plan) -> list[str]:
    """List the mirrors and virtual units that have values of a device."""
    mirrors = [f"{mirror.unit} {mirror.name}" for mirror in plan.mirrors if mirror.of == device.name]
    return mirrors + [f"{unit.unit} {unit.name}" for unit in plan.virtual if device.name in unit.devices]
