"""The upstreams and server lines of a config, as `check` shows them."""

from typing import Any

from gateway.cli.kit.columns import align
from gateway.cli.show.limits import milliseconds, round_up
from gateway.cli.show.lines import show_silence
from gateway.cli.show.listeners import ON_FAILURE_SILENT, listeners_for, through
from gateway.cli.show.sites import timeout_advice
from gateway.config.machine.port_trouble import predict_wire
from gateway.config.plan.forecast import (
    longest_wait_outside,
    longest_waits_behind,
    waits_behind,
)
from gateway.config.plan.settings import Plan, ServerPlan, UpstreamPlan
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_unit


def upstream_as_text(plan: UpstreamPlan, whole: Plan) -> str:
    """Show an upstream and the units behind it."""
    settings, waits = plan.upstream, longest_waits_behind(plan)
    wait = round_up(max(waits.values()))
    rows = [(show_unit(device.client_unit), str(device.unit), round_up(waits[device.name])) for device in plan.devices]
    is_shared = any(device.client_unit is not None for device in plan.devices)
    names = through(listeners_for(settings.name, whole), is_shared=is_shared)
    return "\n".join(
        [
            f"Upstream {settings.name}: {plan.port.port}",
            f"  {settings.in_flight} in flight",
            *([align([("UNIT", "BEHIND THE SERVER", "LONGEST WAIT"), *rows], "  ")] if rows else []),
            *([f"{names}: 0-255, as behind the server; longest wait {wait}."] if names else []),
            *timeout_advice(plan),
        ]
    )


def server_as_text(server: ServerPlan, plan: Plan) -> str:
    """Show a server line, and what answers for its units."""
    line, timing = server.line, server.line.timing
    rows = [(str(unit), name, round_up(wait)) for unit, (name, wait) in waits_behind(server, plan).items()]
    silence, wire = show_silence(line.silence_before_response), predict_wire(line.wire, server.port)
    return "\n".join(
        [
            f"Server line {line.name}: {server.port.port}",
            f"  {timing.mode} {timing.baud} {timing.format}, silence before a response {silence}, wire {wire}",
            align([("UNIT", "ANSWERED BY", "LONGEST WAIT"), *rows], "  "),
            f"  A response that takes longer than {show_duration(line.answer_within)} is not sent.",
            *([f"  On failure: {ON_FAILURE_SILENT}"] if line.on_failure == "silent" else []),
            f"  Broadcasts go to: {server.broadcast_to}.",
            f"  Set the time-out of the client on this line above {round_up(longest_wait_outside(server))}.",
        ]
    )


def upstream_as_json(plan: UpstreamPlan, whole: Plan) -> dict[str, Any]:
    """Make an upstream for programs."""
    waits = longest_waits_behind(plan)
    return {
        "name": plan.upstream.name,
        "to": plan.port.port,
        "in_flight": plan.upstream.in_flight,
        "own_listeners": listeners_for(plan.upstream.name, whole),
        "longest_wait_ms": milliseconds(max(waits.values())),
        "units": [
            {
                "unit": None if device.client_unit is None else str(device.client_unit),
                "behind_the_server": str(device.unit),
                "device": device.name,
                "longest_wait_ms": milliseconds(waits[device.name]),
            }
            for device in plan.devices
        ],
    }


def server_as_json(server: ServerPlan, plan: Plan) -> dict[str, Any]:
    """Make a server line for programs."""
    line, timing = server.line, server.line.timing
    return {
        "name": line.name,
        "port": server.port.port,
        "mode": timing.mode,
        "baud": timing.baud,
        "format": str(timing.format),
        "silence_before_response_ms": milliseconds(line.silence_before_response),
        "wire": predict_wire(line.wire, server.port),
        "on_failure": line.on_failure,
        "answer_within_ms": milliseconds(line.answer_within),
        "broadcast_to": server.broadcast_to,
        "longest_wait_ms": milliseconds(longest_wait_outside(server)),
        "units": [
            {"unit": unit, "answered_by": name, "longest_wait_ms": milliseconds(wait)}
            for unit, (name, wait) in waits_behind(server, plan).items()
        ],
    }
