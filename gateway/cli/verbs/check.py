"""`check`: the problems of a config file, and its effect."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import ceil, floor, log10
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.cli.show.images import images_as_json, images_as_text, mirrors_as_json
from gateway.cli.show.line_load import polls_as_json, polls_as_text, rates_as_json, rates_as_text
from gateway.cli.show.published import published_as_json, published_as_text
from gateway.cli.show.rights import rights_as_json, rights_as_text
from gateway.cli.show.sites import sites_as_json, sites_as_text, timeout_advice
from gateway.config.documents.json_schema import json_schema
from gateway.config.load import Loaded, load
from gateway.config.machine.address_trouble import address_trouble
from gateway.config.machine.port_trouble import predict_wire
from gateway.config.plan.forecast import (
    FunctionLimits,
    function_limits,
    longest_wait,
    longest_wait_behind,
    longest_wait_outside,
    times_for_repeats,
    waits_behind,
)
from gateway.config.plan.line_load import load_of, read_rates, total_share
from gateway.config.plan.settings import LinePlan, Plan, ServerPlan, UpstreamPlan
from gateway.config.problem import Problem, dotted
from gateway.config.resolve import resolve
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_units
from gateway.devices.device import DeviceSettings
from gateway.errors import StateError
from gateway.events import AddressRemembered, BaudRemembered
from gateway.listeners.settings import ListenSettings
from gateway.listeners.sockets import url
from gateway.readconfig.file_troubles import with_file_troubles
from gateway.runtime.remembered import in_force
from gateway.state.memory import read_memory, state_folder

_LONGEST_WAIT: Final = "Longest wait = max_wait + gap + longest request on the wire + its time limit."
_LONGEST_WAIT_FOR_REPEATS: Final = "With retries it is max_wait + gap + retry_within, if that is longer."
_ADVICE: Final = """\
Set each client's time-out above the longest wait of the units that it polls.
The longest wait is valid for up to in_flight requests at once per connection;
further requests are read later."""

_SILENCE: Final = "no response instead of 06, 0A and 0B."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `check`."""
    parser.add_argument("config", nargs="?", default=DEFAULT_CONFIG, help=f"the config file (default {DEFAULT_CONFIG})")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON instead of tables")
    output.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of config files for an editor, and read no file"
    )


def run(args: argparse.Namespace) -> int:
    """Print every problem, and the effect of a file without errors; 1 if there is an error."""
    if args.schema:
        print(json.dumps(json_schema(), indent=1, ensure_ascii=False))
        return FINE
    loaded = _load_and_look(args.config)
    plan = None if loaded.config is None else resolve(loaded.config)
    print(json.dumps(_as_json(loaded, plan), indent=2, ensure_ascii=False) if args.json else _as_text(loaded, plan))
    return PROBLEM_FOUND if plan is None else FINE


def _load_and_look(file: str) -> Loaded:
    """Load the file, and add what would keep the service of this machine from using it."""
    return with_file_troubles(load(file, address_trouble), file)


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
        return self.device.name if self.units == str(self.device.known_as) else "(each)"


def _units(plan: LinePlan, whole: Plan) -> list[_Unit]:
    """The units of a line; for passed-through units, without those that a mirror hides."""
    if plan.passes_through:
        mirrors = {mirror.unit for mirror in whole.mirrors}
        shared = [device for device in plan.shared if device.known_as not in mirrors]
        units = show_units(device.known_as for device in (shared if plan.shared else plan.devices))
        return [_unit(plan, plan.devices[0], units, "same")] if units else []
    return [_unit(plan, device, str(device.known_as), str(device.unit)) for device in plan.devices]


def _unit(plan: LinePlan, device: DeviceSettings, units: str, wire_units: str) -> _Unit:
    limits = function_limits(device.profile, device.answer_time, plan.line.timing, plan.latency)
    return _Unit(units, wire_units, device, limits, longest_wait(plan, device))


def _as_text(loaded: Loaded, plan: Plan | None) -> str:
    parts = ["\n".join(map(str, _with_help_once(loaded.problems)))] if loaded.problems else []
    if plan is None:
        return "\n".join([*parts, _verdict(loaded.problems)])
    parts += [_listeners(plan.listeners), rights_as_text(plan)]
    parts += [_line(line, plan) for line in plan.lines]
    parts += [_upstream(upstream, plan) for upstream in plan.upstreams]
    parts += sites_as_text(plan)
    parts += [_server(server, plan) for server in plan.servers]
    parts += images_as_text(plan)
    parts += published_as_text(plan)
    parts += _remembered(plan)
    if plan.lines or plan.upstreams:
        parts.append(_advice(plan))
    return "\n\n".join([*parts, _verdict(loaded.problems)])


def _advice(plan: Plan) -> str:
    repeats = [_LONGEST_WAIT_FOR_REPEATS] if any(line.line.retries for line in plan.lines) else []
    return "\n".join([_LONGEST_WAIT, *repeats, _ADVICE])


def _with_help_once(problems: tuple[Problem, ...]) -> Iterator[Problem]:
    """The problems; of those that are the same in several places, the last one has the help."""
    for problem, following in zip_longest(problems, problems[1:]):
        is_alike = following is not None and (following.what, following.remedy) == (problem.what, problem.remedy)
        yield replace(problem, remedy="") if is_alike else problem


def _verdict(problems: tuple[Problem, ...]) -> str:
    errors = sum(problem.severity == "error" for problem in problems)
    warnings = len(problems) - errors
    return f"{_count(errors, 'error')}, {_count(warnings, 'warning')}"


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _listeners(listeners: tuple[ListenSettings, ...]) -> str:
    rows = [(one.name, _address(one), _places(one), _idle(one), str(one.unit0), _leads_to(one)) for one in listeners]
    table = align([("NAME", "ADDRESS", "CLIENTS", "IDLE", "UNIT 0", "LEADS TO"), *rows], "  ")
    silent = [f"  Through {one.name}: {_SILENCE}" for one in listeners if one.on_failure == "silent"]
    return "\n".join(["Listeners", table, *silent])


def _leads_to(listener: ListenSettings) -> str:
    kind = "line" if listener.line else "upstream"
    return f"{kind} {listener.only}" if listener.only else "all units"


def _address(listener: ListenSettings) -> str:
    return url(listener.scheme, listener.host, listener.port)


def _places(listener: ListenSettings) -> str:
    return f"{listener.clients}, {listener.reserve} reserved" if listener.reserve else str(listener.clients)


def _idle(listener: ListenSettings) -> str:
    return show_duration(listener.idle) if listener.idle else "never"


def _line(plan: LinePlan, whole: Plan) -> str:
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
    """What happens after a failure, where that is not the default."""
    line = plan.line
    if line.retries:
        yield f"  retries {line.retries}, retry_within {_retry_within(plan)}"
    if line.rest is not None:
        yield f"  rest {show_duration(line.rest) if line.rest else 'off'}"


def _retry_within(plan: LinePlan) -> str:
    """How long a read may take with its repeats."""
    if plan.line.retry_within is not None:
        return show_duration(plan.line.retry_within)
    least, most = map(show_duration, times_for_repeats(plan))
    return f"auto: {least}" if least == most else f"auto: {least} to {most}, by the size of the read"


def _list_listeners(plan: LinePlan, whole: Plan) -> Iterator[str]:
    """The addresses that the listeners for this line lead to."""
    through = _through(_listeners_for(plan.line.name, whole), is_shared=bool(plan.shared))
    if through:
        yield f"{through}: {show_units(plan.addresses)}, as on the wire."


def _through(listeners: list[str], *, is_shared: bool) -> str:
    names = ", ".join(f'"{name}"' for name in listeners)
    return names and f"  Through {names}{'' if is_shared else ' and no other listener'}"


def _listeners_for(name: str, whole: Plan) -> list[str]:
    return [one.name for one in whole.listeners if one.only == name]


def _gap(plan: LinePlan) -> str:
    return _silence(plan.line.silence_before_request)


def _silence(seconds: float) -> str:
    return show_duration(seconds) if seconds else "none"


def _latency(plan: LinePlan) -> str:
    return show_duration(plan.latency) + (" (USB: up to 20 ms)" if plan.port.latency is None else "")


def _row(unit: _Unit) -> tuple[str, ...]:
    return unit.units, unit.wire_units, unit.device_name, unit.device.profile.name, _round_up(unit.longest_wait)


def _round_up(seconds: float) -> str:
    """The time rounded up to the three digits that are shown."""
    if not seconds:
        return "at once"
    step = max(0.01, 10.0 ** (floor(log10(seconds)) - 2))
    return show_duration(ceil(seconds / step) * step)


def _server(server: ServerPlan, plan: Plan) -> str:
    line, timing = server.line, server.line.timing
    rows = [(str(unit), name, _round_up(wait)) for unit, (name, wait) in waits_behind(server, plan).items()]
    silence, wire = _silence(line.silence_before_response), predict_wire(line.wire, server.port)
    return "\n".join(
        [
            f"Server line {line.name}: {server.port.port}",
            f"  {timing.mode} {timing.baud} {timing.format}, silence before a response {silence}, wire {wire}",
            align([("UNIT", "ANSWERED BY", "LONGEST WAIT"), *rows], "  "),
            f"  A response that takes longer than {show_duration(line.answer_within)} is not sent.",
            *([f"  On failure: {_SILENCE}"] if line.on_failure == "silent" else []),
            f"  Broadcasts go to: {server.broadcast_to}.",
            f"  Set the time-out of the client on this line above {_round_up(longest_wait_outside(server))}.",
        ]
    )


def _limits(units: list[_Unit], plan: LinePlan) -> Iterator[str]:
    """Tables for each kind of device on the line: its time limits, and how often it can be read."""
    alike: dict[tuple[str, tuple[FunctionLimits, ...]], list[_Unit]] = {}
    for unit in units:
        alike.setdefault((unit.device.profile.name, unit.limits), []).append(unit)
    for (name, limits), same in alike.items():
        yield f"  Time limits of {name}, {_name_units(same)}\n{limits_table(limits, '    ')}"
        yield from rates_as_text(read_rates(plan, same[0].device), f"{name}, {_name_units(same)}")


def _name_units(units: list[_Unit]) -> str:
    text = units[0].units if len(units) == 1 else show_units(unit.device.known_as for unit in units)
    return f"unit{'' if text.isdecimal() else 's'} {text}"


def limits_table(limits: tuple[FunctionLimits, ...], indent: str) -> str:
    """The limits of each function as a table."""
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


def _upstream(plan: UpstreamPlan, whole: Plan) -> str:
    settings, wait = plan.upstream, _round_up(longest_wait_behind(plan))
    rows = [(str(device.known_as), str(device.unit), wait) for device in plan.devices]
    through = _through(_listeners_for(settings.name, whole), is_shared=bool(rows))
    return "\n".join(
        [
            f"Upstream {settings.name}: {plan.port.port}",
            f"  timeout {show_duration(settings.timeout)}, {settings.in_flight} in flight",
            *([align([("UNIT", "BEHIND THE SERVER", "LONGEST WAIT"), *rows], "  ")] if rows else []),
            *([f"{through}: 0-255, as behind the server; longest wait {wait}."] if through else []),
            *timeout_advice(plan),
        ]
    )


def _remembered(plan: Plan) -> list[str]:
    """The values that the gateway uses instead of the config, if the same user runs it."""
    try:
        rows = [f"  {each.line}: {_describe_remembered(each)}; {each.advice}" for each in _in_force(plan)]
    except StateError as error:
        rows = [f"  {error}"]
    return ["\n".join(["Remembered from an earlier run", *rows])] if rows else []


def _remembered_as_json(plan: Plan) -> list[dict[str, Any]] | None:
    """The remembered values; None if the file cannot be read."""
    try:
        return [each.fields() for each in _in_force(plan)]
    except StateError:
        return None


def _in_force(plan: Plan) -> Iterator[AddressRemembered | BaudRemembered]:
    return in_force(plan, read_memory(state_folder()))


def _describe_remembered(each: AddressRemembered | BaudRemembered) -> str:
    if isinstance(each, AddressRemembered):
        return f"{each.device} is polled at {each.unit}, the config says {each.configured}"
    return f"{each.baud} baud, the config says {each.configured}"


def _as_json(loaded: Loaded, plan: Plan | None) -> dict[str, Any]:
    picture: dict[str, Any] = {"problems": [_problem_as_json(problem) for problem in loaded.problems]}
    if plan is not None:
        picture["listeners"] = [
            {
                "name": one.name,
                "address": _address(one),
                "clients": one.clients,
                "reserve": one.reserve,
                "idle_ms": milliseconds(one.idle),
                "in_flight": one.in_flight,
                "unit0": one.unit0,
                "on_failure": one.on_failure,
                "line": one.line or None,
                "upstream": one.upstream or None,
            }
            for one in plan.listeners
        ]
        picture["rights"] = rights_as_json(plan)
        picture["lines"] = [_line_as_json(line, plan) for line in plan.lines]
        picture["remembered"] = _remembered_as_json(plan)
        picture["upstreams"] = [_upstream_as_json(upstream, plan) for upstream in plan.upstreams]
        picture["other_sites"] = sites_as_json(plan)
        picture["servers"] = [_server_as_json(server, plan) for server in plan.servers]
        picture["images"] = images_as_json(plan)
        picture["mirrors"] = mirrors_as_json(plan)
        picture["published"] = published_as_json(plan)
    return picture


def _problem_as_json(problem: Problem) -> dict[str, Any]:
    return {
        "severity": problem.severity,
        "file": problem.file,
        "line": problem.line or None,
        "column": problem.column or None,
        "path": dotted(problem.path),
        "what": problem.what,
        "help": problem.remedy,
    }


def _line_as_json(plan: LinePlan, whole: Plan) -> dict[str, Any]:
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
        "shared": bool(plan.shared),
        "own_listeners": _listeners_for(plan.line.name, whole),
        "addresses": show_units(plan.addresses),
        "polls": polls_as_json(load),
        "polls_share": round(total_share(load), 4),
        "units": [_unit_as_json(unit, plan) for unit in _units(plan, whole)],
    }


def _upstream_as_json(plan: UpstreamPlan, whole: Plan) -> dict[str, Any]:
    return {
        "name": plan.upstream.name,
        "to": plan.port.port,
        "timeout_ms": milliseconds(plan.upstream.timeout),
        "in_flight": plan.upstream.in_flight,
        "own_listeners": _listeners_for(plan.upstream.name, whole),
        "longest_wait_ms": milliseconds(longest_wait_behind(plan)),
        "units": [
            {
                "unit": str(device.known_as),
                "behind_the_server": str(device.unit),
                "longest_wait_ms": milliseconds(longest_wait_behind(plan)),
            }
            for device in plan.devices
        ],
    }


def _server_as_json(server: ServerPlan, plan: Plan) -> dict[str, Any]:
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


def _unit_as_json(unit: _Unit, plan: LinePlan) -> dict[str, Any]:
    return {
        "unit": unit.units,
        "on_the_wire": unit.wire_units,
        "device": unit.device_name,
        "profile": unit.device.profile.name,
        "longest_wait_ms": milliseconds(unit.longest_wait),
        "limits": limits_as_json(unit.limits),
        "reads": rates_as_json(read_rates(plan, unit.device)),
    }


def limits_as_json(limits: tuple[FunctionLimits, ...]) -> list[dict[str, Any]]:
    """The limits of each function; `function` is None for all others."""
    return [
        {
            "function": one.function,
            "one_item_ms": milliseconds(one.one_item),
            "most_items": one.most,
            "most_items_ms": milliseconds(one.most_items),
        }
        for one in limits
    ]


def milliseconds(seconds: float) -> float:
    """A time as in JSON output."""
    return round(seconds * 1000, 3)
