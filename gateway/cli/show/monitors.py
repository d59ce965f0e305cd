"""The lines of a config on which the gateway only listens, as `check` shows them."""

from typing import Any

from gateway.cli.kit.columns import align
from gateway.cli.show.limits import milliseconds, round_up
from gateway.config.machine.port_trouble import predict_wire
from gateway.config.plan.forecast import heard_window
from gateway.config.plan.settings import MonitorPlan, Plan
from gateway.config.values.unitset import show_unit
from gateway.devices.device import DeviceSettings


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
