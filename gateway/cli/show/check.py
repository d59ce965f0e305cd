"""All that `check` prints of a config: its problems, and its effect."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.show.images import guarded_as_json, guarded_as_text, images_as_json, images_as_text, mirrors_as_json
from gateway.cli.show.lines import line_as_json, line_as_text, monitor_as_json, monitor_as_text
from gateway.cli.show.listeners import listeners_as_json, listeners_as_text, rights_as_json, rights_as_text
from gateway.cli.show.published import published_as_json, published_as_text
from gateway.cli.show.servers import (
    server_as_json,
    server_as_text,
    sites_as_json,
    sites_as_text,
    upstream_as_json,
    upstream_as_text,
)
from gateway.cli.show.virtual import virtual_as_json, virtual_as_text
from gateway.config.load import Loaded
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, dotted
from gateway.config.values.duration import show_duration
from gateway.errors import StateError
from gateway.events import AddressRemembered, BaudRemembered
from gateway.operator.trends.numbers import has_trend
from gateway.runtime.remembered import in_force
from gateway.state.memory import read_memory, state_folder
from gateway.timing.trend import SHORT, Layout

_LONGEST_WAIT: Final = "Longest wait = max_wait + gap + longest request on the wire + its time limit."
_LONGEST_WAIT_FOR_REPEATS: Final = "With retries it is max_wait + gap + retry_within, if that is longer."
_LONGEST_WAIT_BEHIND: Final = (
    "Behind an upstream it is max_wait + gap + after_connect + its time limit, and more where reads are repeated."
)
_ADVICE: Final = """\
Set each client's time-out above the longest wait of the units that it polls.
The longest wait is valid for up to in_flight requests at once per connection;
further requests are read later."""


def check_as_text(loaded: Loaded, plan: Plan | None, folder: Path, in_words: Callable[[Problem], str] = str) -> str:
    """Show problems, each `in_words`, and the effect for people; `plan` is None if there are errors.

    `folder` is that of the control socket.
    """
    parts = ["\n".join(map(in_words, _with_help_once(loaded.problems)))] if loaded.problems else []
    if plan is None:
        return "\n".join([*parts, _verdict(loaded.problems)])
    parts += [listeners_as_text(plan.listeners), rights_as_text(plan)]
    parts += [line_as_text(line, plan) for line in plan.lines]
    parts += [upstream_as_text(upstream, plan) for upstream in plan.upstreams]
    parts += sites_as_text(plan)
    parts += [server_as_text(server, plan, folder) for server in plan.servers]
    parts += [monitor_as_text(monitor, plan) for monitor in plan.monitors]
    parts += images_as_text(plan)
    parts += virtual_as_text(plan)
    parts += guarded_as_text(plan)
    parts += published_as_text(plan)
    parts += trends_as_text(plan)
    parts += _profiles(loaded)
    parts += _remembered(plan)
    if plan.lines or plan.upstreams:
        parts.append(_advice(plan))
    return "\n\n".join([*parts, _verdict(loaded.problems)])


def _advice(plan: Plan) -> str:
    parts = [_LONGEST_WAIT] if plan.lines else []
    parts += [_LONGEST_WAIT_FOR_REPEATS] if any(line.line.retries for line in plan.lines) else []
    parts += [_LONGEST_WAIT_BEHIND] if plan.upstreams else []
    return "\n".join([*parts, _ADVICE])


def _with_help_once(problems: tuple[Problem, ...]) -> Iterator[Problem]:
    """Give the problems; of those that are the same in several places, the last one has the help."""
    for problem, following in zip_longest(problems, problems[1:]):
        is_alike = following is not None and (following.what, following.remedy) == (problem.what, problem.remedy)
        yield replace(problem, remedy="") if is_alike else problem


def _verdict(problems: tuple[Problem, ...]) -> str:
    errors = sum(problem.severity == "error" for problem in problems)
    warnings = len(problems) - errors
    return f"{_count(errors, 'error')}, {_count(warnings, 'warning')}"


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _profiles(loaded: Loaded) -> list[str]:
    """Show where profiles come from that are not shipped ones."""
    rows = [(each.name, str(each)) for each in loaded.profiles]
    return [f"Profiles\n{align([('NAME', 'FROM'), *rows], '  ')}"] if rows else []


def _remembered(plan: Plan) -> list[str]:
    """Show the values that the gateway uses instead of the config, if the same user runs it."""
    try:
        rows = [f"  {each.line}: {_describe_remembered(each)}; {each.advice}" for each in _in_force(plan)]
    except StateError as error:
        rows = [f"  {error}"]
    return ["\n".join(["Remembered from an earlier run", *rows])] if rows else []


def _remembered_as_json(plan: Plan) -> list[dict[str, Any]] | None:
    """Make the remembered values for programs; None if the file cannot be read."""
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


def check_as_json(loaded: Loaded, plan: Plan | None, folder: Path) -> dict[str, Any]:
    """Make the same for programs."""
    picture: dict[str, Any] = {"problems": [_problem_as_json(problem) for problem in loaded.problems]}
    if plan is not None:
        picture["listeners"] = listeners_as_json(plan.listeners)
        picture["rights"] = rights_as_json(plan)
        picture["lines"] = [line_as_json(line, plan) for line in plan.lines]
        picture["remembered"] = _remembered_as_json(plan)
        picture["upstreams"] = [upstream_as_json(upstream, plan) for upstream in plan.upstreams]
        picture["other_sites"] = sites_as_json(plan)
        picture["servers"] = [server_as_json(server, plan, folder) for server in plan.servers]
        picture["monitors"] = [monitor_as_json(monitor, plan) for monitor in plan.monitors]
        picture["images"] = images_as_json(plan)
        picture["mirrors"] = mirrors_as_json(plan)
        picture["virtual_units"] = virtual_as_json(plan)
        picture["guarded_points"] = guarded_as_json(plan)
        picture["published"] = published_as_json(plan)
        picture["trends"] = trends_as_json(plan)
        picture["profiles"] = [{"name": each.name, "from": each.place, "hides": each.hides} for each in loaded.profiles]
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


def trends_as_text(plan: Plan) -> list[str]:
    """Show slots and room, if any trend is kept."""
    points = _points(plan)
    if plan.web is None or not plan.web.values or not points:
        return []
    layout = Layout.of(plan.web.values)
    room = f"room for about {layout.points // 100 * 100} points that always change"
    here = f"{points} point{'' if points == 1 else 's'} here"
    enough = "" if points <= layout.points else ": the oldest slots are dropped earlier, if more than that change"
    return [f"Trends\n  kept for {_time(layout.kept)} in slots of {layout.step // 60} min; {room}, {here}{enough}"]


def trends_as_json(plan: Plan) -> dict[str, int] | None:
    """Make the same for programs; None if no trends are kept."""
    if plan.web is None or not plan.web.values:
        return None
    layout = Layout.of(plan.web.values)
    return {"kept_s": layout.kept, "step_s": layout.step, "room_for_points": layout.points, "points": _points(plan)}


def _points(plan: Plan) -> int:
    """Count the points of devices that have a trend."""
    return sum(has_trend(point) for device in plan.shared for point in plan.points.get(device.known_as, ()))


def _time(seconds: int) -> str:
    if seconds > SHORT and seconds % SHORT == 0:
        return f"{seconds // SHORT} days"
    return show_duration(seconds) if seconds % 3600 else f"{seconds // 3600} h"
