"""The profiles that are shipped, by name."""

import tomllib
from functools import cache
from importlib.resources import files

from gateway.config.plan.points import points_of
from gateway.config.schema.profile import ProfileTable
from gateway.profiles.point import Point

SHIPPED = sorted(file.name[:-5] for file in files("gateway.profiles").iterdir() if file.name.endswith(".toml"))


def shipped_text(name: str) -> str:
    """The file of a shipped profile."""
    return files("gateway.profiles").joinpath(f"{name}.toml").read_text(encoding="utf-8")


@cache
def shipped(name: str) -> ProfileTable:
    """The table of a shipped profile."""
    return ProfileTable.model_validate(tomllib.loads(shipped_text(name))["profile"][name])


def shipped_points(name: str) -> tuple[Point, ...]:
    """Its points."""
    return points_of(shipped(name).points, shipped(name))
