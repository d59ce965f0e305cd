"""The images, mirrors and units made in Python of a config, as `check` shows them."""

from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.config.plan.images import EVERY_ADDRESS
from gateway.config.plan.settings import Plan
from gateway.config.values.duration import show_duration
from gateway.config.values.ranges import show_ranges
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.modbus.codes import Area

_MIRRORS: Final = "Mirrors: reads are answered at once, writes take as long as at the device"


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
