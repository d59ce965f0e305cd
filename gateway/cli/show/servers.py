"""The upstreams and server lines of a config, as `check` shows them, and how long other sites may have to wait."""

from collections.abc import Iterator
from math import ceil
from pathlib import Path
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.show.devices import (
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
)
from gateway.cli.show.line_load import polls_as_json, polls_as_text
from gateway.cli.show.lines import show_silence
from gateway.cli.show.listeners import ON_FAILURE_SILENT, listeners_for, through
from gateway.config.machine.troubles import predict_wire
from gateway.config.plan.forecast import (
    least_timeouts_at_other_sites,
    longest_wait_outside,
    longest_waits_behind,
    waits_behind,
)
from gateway.config.plan.line_load import load_of, total_share
from gateway.config.plan.settings import Plan, ServerPlan, UpstreamPlan
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_units
from gateway.ports.port import PtySettings, SiteSettings
from gateway.upstreams.settings import UpstreamSettings

_FOR_PROGRAMS: Final = "  For programs of this machine; set them to {}, and any rate."


def upstream_as_text(plan: UpstreamPlan, whole: Plan) -> str:
    """Show an upstream, the units behind it with their time limits, and what its polls take of the connection."""
    waits = longest_waits_behind(plan)
    devices = shown_devices(plan, plan.devices, waits)
    names = through(listeners_for(plan.name, whole), is_shared=any(one.client_unit is not None for one in plan.devices))
    longest = round_up(max(waits.values()))
    return "\n".join(
        [
            f"Upstream {plan.name}: {', else '.join(port.port for port in (plan.port, *plan.others))}",
            f"  {', '.join(_pace(plan))}",
            *_peculiarities(plan.upstream),
            *failures_as_text(plan.upstream),
            *([devices_table(devices, "BEHIND THE SERVER", units_that_write(whole))] if devices else []),
            *([f"{names}: 0-255, as behind the server; longest wait {longest}."] if names else []),
            *timeout_advice(plan),
            *wakes_as_text(plan),
            *polls_as_text(plan, whole),
            *(limits_as_text(one, of) for one, of in one_of_each_kind(devices)),
        ]
    )


def _pace(plan: UpstreamPlan) -> Iterator[str]:
    """Say when the server is asked: how many requests at once, and what else is not the default."""
    settings = plan.upstream
    yield f"{settings.in_flight} in flight"
    if settings.gap:
        yield f"gap {show_duration(settings.gap)}"
    if settings.after_connect:
        yield f"{show_duration(settings.after_connect)} of silence after connecting"
    if settings.idle:
        yield f"closed after {show_duration(settings.idle)} without a request"


def _peculiarities(settings: UpstreamSettings) -> Iterator[str]:
    if settings.transaction_id == "zero":
        yield "  responses with transaction identifier 0 are taken too"
    if not settings.coalesce:
        yield "  equal reads do not share a transaction"


def _port_of(server: ServerPlan, folder: Path) -> str:
    """Name the port; the link of a virtual one is in `folder`."""
    port = server.port
    return f"pty:{folder / port.name}" if isinstance(port, PtySettings) else port.port


def _units_as_text(server: ServerPlan, plan: Plan) -> Iterator[str]:
    """Show the units, and what answers for each; neighbours on the same pass-through line in one row."""
    rows: list[tuple[list[int], str, str]] = []
    passing = {device.name: line.name for line in plan.lines if line.passes_through for device in line.devices}
    heard = {device.name for monitor in plan.monitors for device in monitor.devices}
    for unit, (name, wait) in waits_behind(server, plan).items():
        told = f"line {passing[name]}" if name in passing else name
        longest = "0A: only heard" if name in heard else round_up(wait)
        if rows and name in passing and rows[-1][1:] == (told, longest):
            rows[-1][0].append(unit)
        else:
            rows.append(([unit], told, longest))
    yield align([("UNIT", "ANSWERED BY", "LONGEST WAIT"), *((show_units(at), *more) for at, *more in rows)], "  ")
    if server.serves_all:
        yield "  A unit that is added to the config is served too."


def server_as_text(server: ServerPlan, plan: Plan, folder: Path) -> str:
    """Show a server line, and what answers for its units. `folder` is that of the control socket."""
    line, timing = server.line, server.line.timing
    silence, wire = show_silence(line.silence_before_response), predict_wire(line.wire, server.port)
    return "\n".join(
        [
            f"Server line {line.name}: {_port_of(server, folder)}",
            f"  {timing.mode} {timing.baud} {timing.format}, silence before a response {silence}, wire {wire}",
            *([_FOR_PROGRAMS.format(timing.format)] if isinstance(server.port, PtySettings) else []),
            *_units_as_text(server, plan),
            f"  A response that takes longer than {show_duration(line.answer_within)} is not sent.",
            *([f"  On failure: {ON_FAILURE_SILENT}"] if line.on_failure == "silent" else []),
            f"  Broadcasts go to: {server.broadcast_to}.",
            f"  Set the time-out of the client on this line above {round_up(longest_wait_outside(server))}.",
        ]
    )


def upstream_as_json(plan: UpstreamPlan, whole: Plan) -> dict[str, Any]:
    """Make an upstream for programs."""
    settings, waits, load = plan.upstream, longest_waits_behind(plan), load_of(plan, whole)
    writers = units_that_write(whole)
    return {
        "name": plan.name,
        "to": plan.port.port,
        "others": [other.port for other in plan.others],
        "in_flight": settings.in_flight,
        "gap_ms": milliseconds(settings.gap),
        "after_connect_ms": milliseconds(plan.upstream.after_connect),
        "idle_ms": milliseconds(settings.idle),
        "transaction_id": settings.transaction_id,
        "coalesce": settings.coalesce,
        "retries": settings.retries,
        "rest_ms": None if settings.rest is None else milliseconds(settings.rest),
        "own_listeners": listeners_for(plan.name, whole),
        "longest_wait_ms": milliseconds(max(waits.values())),
        "polls": polls_as_json(load),
        "polls_share": round(total_share(load), 4),
        "units": [
            {
                "behind_the_server": one.wire_units,
                **device_as_json(one, writers),
                "wake_ms": milliseconds(one.device.wake),
            }
            for one in shown_devices(plan, plan.devices, waits)
        ],
    }


def server_as_json(server: ServerPlan, plan: Plan, folder: Path) -> dict[str, Any]:
    """Make a server line for programs."""
    line, timing = server.line, server.line.timing
    return {
        "name": line.name,
        "port": _port_of(server, folder),
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


def sites_as_text(plan: Plan) -> list[str]:
    """Show the shortest `timeout` that other sites need for each line and upstream, if there are other sites."""
    rows = [(name, show_duration(timeout)) for name, timeout in _timeouts(plan).items()]
    if plan.fleet is None or not rows:
        return []
    advice = f"  At other sites, the [[upstream]] to fleet://{plan.fleet.site} needs this timeout or a longer one."
    return ["\n".join(["Other sites", align([("UNITS OF", "TIMEOUT"), *rows], "  "), advice])]


def sites_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the same for programs; times are in milliseconds."""
    return [{"units_of": name, "timeout_ms": round(1000 * timeout)} for name, timeout in _timeouts(plan).items()]


def timeout_advice(plan: UpstreamPlan) -> list[str]:
    """Say where to find how long `timeout` must be, if units of another site are asked."""
    if not isinstance(plan.port, SiteSettings):
        return []
    return [f"  check at {plan.port.site} prints which timeout its units need."]


def _timeouts(plan: Plan) -> dict[str, float]:
    """Calculate the shortest time-outs, rounded up to tenths of seconds."""
    timeouts = {} if plan.fleet is None else least_timeouts_at_other_sites(plan)
    return {name: ceil(10 * timeout) / 10 for name, timeout in timeouts.items()}
