"""The images, mirrors and units made in Python of a config, as `check` shows them; and which points are guarded."""

from collections.abc import Iterator
from itertools import islice
from typing import Any, Final

from gateway.cli.kit.columns import align, without_middles
from gateway.config.plan.images import EVERY_ADDRESS
from gateway.config.plan.settings import LinePlan, Plan, UpstreamPlan
from gateway.config.problem import listed
from gateway.config.values.duration import show_duration
from gateway.config.values.ranges import show_ranges
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.modbus.codes import Area
from gateway.modbus.functions import FUNCTIONS, KNOWN_FUNCTIONS
from gateway.profiles.guards import Guard
from gateway.profiles.profile import Profile

_MIRRORS: Final = "Mirrors: reads are answered at once, writes take as long as at the device"
#: Functions that may write, and nobody can tell where.
_UNKNOWN: Final = frozenset(
    code
    for code in range(1, 128)
    if code not in KNOWN_FUNCTIONS or (FUNCTIONS[code].effect == "write" and FUNCTIONS[code].writes is None)
)


def images_as_text(plan: Plan) -> list[str]:
    """Show a table of the images, of the mirrors and of the units made in Python, if there are any."""
    images = [
        (str(one.unit), one.name, one.profile.name, one.persist, _areas(one)) for one in plan.images if not one.python
    ]
    mirrors = [(str(one.unit), one.name, one.of, show_duration(one.stale), _polls(one, plan)) for one in plan.mirrors]
    made = [
        (str(one.unit), one.name, one.python, show_duration(one.timeout), one.profile.name, _areas(one))
        for one in plan.images
        if one.python
    ]
    tables = (
        ("Images", ("UNIT", "NAME", "PROFILE", "KEPT", "ADDRESSES"), images),
        (_MIRRORS, ("UNIT", "NAME", "OF", "STALE", "POLLED"), mirrors),
        ("Units made in Python: one request after the other; 0B for one that takes longer than its timeout",
         ("UNIT", "NAME", "CLASS", "TIMEOUT", "PROFILE", "ADDRESSES"), made),
    )  # fmt: skip
    shown = {title: f"{title}\n{align([headings, *rows], '  ')}" for title, headings, rows in tables if rows}
    if any(one.of in plan.heard_on for one in plan.mirrors):
        shown[_MIRRORS] += "\n  Nothing can be written through a mirror of what is heard: writes get 0A."
    return [*shown.values()]


def images_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the images for programs; times are in milliseconds."""
    return [
        {
            "unit": one.unit,
            "name": one.name,
            "profile": one.profile.name,
            "persist": one.persist,
            "areas": one.areas,
        }
        | ({"python": one.python, "timeout_ms": 1000 * one.timeout} if one.python else {})
        for one in plan.images
    ]


def mirrors_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the mirrors for programs; times are in milliseconds. What is only heard is polled every 0."""
    return [
        {
            "unit": one.unit,
            "name": one.name,
            "of": one.of,
            "stale_ms": 1000 * one.stale,
            "polls": [{"addresses": str(poll), "every_ms": 1000 * poll.every} for poll in one.polls],
        }
        | ({"heard_on": plan.heard_on[one.of]} if one.of in plan.heard_on else {})
        for one in plan.mirrors
    ]


def _areas(image: ImageSettings) -> str:
    if image.shows_gateway:
        return "registers of the gateway itself: docs/own-registers.md"
    if all(image.areas.get(area) == EVERY_ADDRESS for area in Area):
        return "all"
    return "; ".join(f"{area} {show_ranges(ranges)}" for area, ranges in image.areas.items())


def _polls(mirror: MirrorSettings, plan: Plan) -> str:
    line = plan.heard_on.get(mirror.of)
    return "; ".join(
        f"{poll} {f'heard on {line}' if line else f'every {show_duration(poll.every)}'}" for poll in mirror.polls
    )


def guarded_as_text(plan: Plan) -> list[str]:
    """Show a table of the guarded points, if there are any, and warn of functions that go past them."""
    rows, unknown = [], []
    for names, profile, is_device in _alike(plan):
        of = listed(names)
        rows += [(of, each.point.name, _place(each), each.point.limits) for each in profile.guards.all]
        if is_device and _has_unknown(profile):
            unknown.append(of)
    if not rows:
        return []
    table = align([("DEVICE", "POINT", "WRITTEN AT", "WITHIN"), *without_middles(rows, (0, 1, 2))], "  ")
    parts = ["Guarded points: every write to them is whole and within their limits, or 03", table]
    if unknown:
        parts.append(
            f"  Functions whose meaning nobody knows may write there too: {'; '.join(unknown)}.\n"
            "  List those that you need in the profile: functions = [3, 6, 16]"
        )
    return ["\n".join(parts)]


def guarded_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the same for programs."""
    return [
        {
            "devices": names,
            "point": guard.point.name,
            "addresses": _place(guard),
            "min": guard.point.minimum,
            "max": guard.point.maximum,
            "unit": guard.point.unit,
            "has_unknown_functions": is_device and _has_unknown(profile),
        }
        for names, profile, is_device in _alike(plan)
        for guard in profile.guards.all
    ]


def _alike(plan: Plan) -> Iterator[tuple[list[str], Profile, bool]]:
    """Yield profiles with guards: with the names of the units that have it, and whether these are devices."""
    units = [(*each, True) for each in _devices(plan)]
    units += [(each.name, each.profile, False) for each in plan.images]
    units += [(each.name, each.profile, False) for each in plan.virtual]
    alike: dict[int, tuple[list[str], Profile, bool]] = {}
    for name, profile, is_device in units:
        if profile.guards:
            alike.setdefault(id(profile.guards), ([], profile, is_device))[0].append(name)
    yield from alike.values()


def _devices(plan: Plan) -> Iterator[tuple[str, Profile]]:
    owners: tuple[LinePlan | UpstreamPlan, ...] = (*plan.lines, *plan.upstreams)  # nobody writes to those of monitors
    for owner in owners:
        if isinstance(owner, LinePlan) and owner.passes_through:
            yield from ((f"{owner.name} (each)", device.profile) for device in owner.devices[:1])
        else:
            yield from ((device.name, device.profile) for device in owner.devices)
        if isinstance(owner, UpstreamPlan):
            yield from ((f"{owner.name} (each other)", device.profile) for device in islice(owner.unnamed, 1))


def _place(guard: Guard) -> str:
    return f"{guard.place.area} {guard.place.addresses}{guard.point.bits_shown}"


def _has_unknown(profile: Profile) -> bool:
    return profile.functions is None or not _UNKNOWN.isdisjoint(profile.functions)
