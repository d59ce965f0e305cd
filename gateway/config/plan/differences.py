"""How two plans differ, by section and name: `line hall-a`."""

from collections.abc import Mapping
from typing import NamedTuple

from gateway.config.plan.settings import Plan


class Differences(NamedTuple):
    """The tables that a reload adds, removes and changes."""

    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[str, ...]


def differences(old: Plan, new: Plan) -> Differences:
    """Find what a reload changes."""
    before, after = _tables(old), _tables(new)
    return Differences(
        added=tuple(name for name in after if name not in before),
        removed=tuple(name for name in before if name not in after),
        changed=tuple(name for name, table in after.items() if name in before and before[name] != table),
    )


def _tables(plan: Plan) -> Mapping[str, object]:
    return {
        **{f"listen {one.name}": one for one in plan.listeners},
        **{f"line {one.line.name}": one.meaning for one in plan.lines},
        **{f"line {one.name}": one for one in plan.monitors},
        **{f"line {server.line.name}": server for server in plan.servers},
        **{f"upstream {one.upstream.name}": one for one in plan.upstreams},
        **{f"image {one.name}": one for one in plan.images},
        **{f"image {mirror.name}": mirror for mirror in plan.mirrors},
        **{f"image {one.name}": one for one in plan.virtual},
        "access": plan.access,
        "trace": plan.ring,
        **{key: part for key, part in plan.add_ons.items() if not part.needs_restart},
    }


def need_restart(at_start: Plan, new: Plan) -> tuple[str, ...]:
    """Find the changes in `new` that apply only after a restart."""
    before, after = _fixed_tables(at_start), _fixed_tables(new)
    return tuple(name for name in before | after if before.get(name) != after.get(name))


def _fixed_tables(plan: Plan) -> dict[str, object]:
    add_ons = {key: part for key, part in plan.add_ons.items() if part.needs_restart}
    return {"log": plan.log, "control": plan.control, **add_ons}
