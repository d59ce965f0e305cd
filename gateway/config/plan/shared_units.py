"""Units that several devices would have, where no listener leads to all units: they belong to none of them."""

from collections import Counter
from typing import TypeVar

from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.reach import leads_everywhere, listeners_for
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.upstream import Upstream

_Owner = TypeVar("_Owner", Line, Upstream)


def without_shared_units(config: Config) -> Config:
    """Leave rows without `as` without units for clients, if they would share some with other rows.

    Only where nobody asks by these units: the line or upstream has a listener of its own, and there is no general
    listener, no server line and no `[fleet]`. And not if a row of `[[access]]` means these units: it would not count
    for them any more, and may have kept somebody from writing.
    """
    has_servers = any(line.role == "server" for line in config.line)
    if leads_everywhere(config) or has_servers or config.fleet is not None:
        return config
    claimed = Counter(unit for owner in owners(config) for row in rows_of(owner) for unit in row.client_units)
    claimed.update(image.unit for image in config.image)
    have_rows = _units_with_rows(config)

    def without_units(row: Device) -> Device:
        is_shared = row.known_as is None and any(claimed[unit] > 1 for unit in row.units)
        is_shared = is_shared and have_rows.isdisjoint(row.units)
        return row.model_copy(update={"known_as": ()}) if is_shared else row

    def changed(owner: _Owner, key: str) -> _Owner:
        if not rows_of(owner) or not listeners_for(owner, config):
            return owner
        return owner.model_copy(update={key: tuple(map(without_units, rows_of(owner)))})

    lines = tuple(changed(line, "devices") for line in config.line)
    upstreams = tuple(changed(upstream, "units") for upstream in config.upstream)
    return config.model_copy(update={"line": lines, "upstream": upstreams})


def _units_with_rows(config: Config) -> frozenset[int]:
    """Find the units for clients that rows of `[[access]]` name. Those that name listeners mean others."""
    listeners = {listen.label for listen in config.listen}
    rows = (row for row in config.access if row.listen is None or not listeners.issuperset(row.listen))
    return frozenset(unit for row in rows if row.units != "all" for unit in row.units)
