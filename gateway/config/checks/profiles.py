"""Cross-checks of profiles, and of the devices that have them."""

from collections.abc import Iterator
from itertools import groupby, pairwise

from gateway.config.checks.lines import other_mode
from gateway.config.plan.lines import spoken_on
from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.reach import client_lines, listeners_for
from gateway.config.problem import Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.upstream import Upstream
from gateway.config.values.duration import show_duration


def check_profiles(config: Config) -> Iterator[Problem]:
    """Find profiles that contradict themselves."""
    for profile in config.profile.values():
        if profile.functions == ():
            yield error((*profile.path, "functions"), "is empty", "leave it out, and every function is accepted")
        yield from _check_timing(profile)


def check_profiles_of_devices(config: Config) -> Iterator[Problem]:
    """Find devices that do not fit their profile: by the mode of their line, or by their time-out."""
    yield from _check_mode(config)
    yield from _check_movable(config)
    yield from _check_timeouts(config)
    yield from _check_unused_timeouts(config)


def _check_timing(profile: ProfileTable) -> Iterator[Problem]:
    rows = sorted(profile.timing, key=lambda row: (row.fc, row.items))
    for function, points in groupby(rows, key=lambda row: row.fc):
        for fewer, more in pairwise(points):
            if fewer.items == more.items:
                yield error((*more.path, "items"), f"function {function} already has a time for {more.items} items")
            elif more.time < fewer.time:
                what = f"function {function} takes less time for {more.items} items than for {fewer.items}"
                yield error((*more.path, "time"), what, "more items cannot take less time")


def _check_mode(config: Config) -> Iterator[Problem]:
    """Find lines with another mode than their devices have."""
    for line in config.line:
        tables: tuple[Line | Device, ...] = (line, *(line.devices or ()))
        for table in tables:
            profile = config.profile.get(table.profile or "")
            if line.role == "client" and profile is not None and profile.mode not in (None, spoken_on(line)):
                what = f"{profile.path[-1]} devices use {profile.mode.upper()}, but this line {spoken_on(line).upper()}"
                yield warning((*table.path, "profile"), what, f"set {other_mode(line)} for the line")


def _check_movable(config: Config) -> Iterator[Problem]:
    """Find devices that can change their address, and share it with another row of their line."""
    for line in client_lines(config):
        rows = line.devices or ()
        movable = [row for row in rows if _has_moves(config.profile.get(row.profile or line.profile))]
        for row in movable:
            shared = {unit for other in rows if other is not row for unit in other.units} & set(row.units)
            if shared:
                what = (
                    f"{min(shared)} is in another row too, and a {row.profile or line.profile} can change its address"
                )
                remedy = "neither is asked while the other may be at this address"
                yield warning((*row.path, "unit"), what, remedy)


def _has_moves(profile: ProfileTable | None) -> bool:
    return profile is not None and "moves" in profile.quirks


def _check_timeouts(config: Config) -> Iterator[Problem]:
    """Find devices with a shorter time-out than the times of their profile, which it replaces."""
    for owner in owners(config):
        for row in rows_of(owner):
            profile = config.profile.get(row.profile or owner.profile)
            if row.timeout is None or profile is None:
                continue
            slowest = max(profile.timing, key=lambda point: point.time, default=None)
            if slowest is not None and row.timeout < slowest.time:
                what = (
                    f"is shorter than the {show_duration(slowest.time)} of {profile.path[-1]} for"
                    f" {slowest.items} items (function {slowest.fc})"
                )
                yield warning(
                    (*row.path, "timeout"), what, "leave timeout out: the profile has a time for each request"
                )


def _check_unused_timeouts(config: Config) -> Iterator[Problem]:
    """Find time-outs of lines and upstreams on which no time limit depends: all devices have a profile of their own."""
    for owner in owners(config):
        rows = rows_of(owner)
        has_others = not rows or (isinstance(owner, Upstream) and bool(listeners_for(owner, config)))
        if owner.has("timeout") and not has_others and all(row.profile or row.timeout for row in rows):
            what = "has no effect: each device has a profile or a time-out of its own"
            yield warning((*owner.path, "timeout"), what, "write it in the row of the device")
