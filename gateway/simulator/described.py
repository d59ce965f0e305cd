"""Kinds of devices as their tables describe them. Apart from `kinds`, as what reads tables takes long to import."""

from gateway.config.plan.points import points_of
from gateway.config.plan.profiles import profile_of
from gateway.config.schema.profile import ProfileTable
from gateway.simulator.profiled import Kind


def kind_of(name: str, table: ProfileTable) -> Kind:
    """Make the kind that a table describes."""
    return Kind(profile_of(name, table), points_of(table.points, table), table.maker, table.mode)
