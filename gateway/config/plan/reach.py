"""Which listeners lead to which lines and upstreams, and to which units of them; units that none of them has."""

from collections import Counter
from typing import TypeVar

from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.settings import DEFAULT_LISTENER
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.upstream import Upstream
from gateway.config.values.address import Address
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT

_Owner = TypeVar("_Owner", Line, Upstream)


def listening(config: Config) -> tuple[tuple[Address, str], ...]:
    """List the addresses where clients can connect, each with its place in the file."""
    return tuple((each.bind, each.place or "the default listener") for each in all_listeners(config))


def all_listeners(config: Config) -> tuple[Listen, ...]:
    """List the listeners in the file, or the default one."""
    if not config.listens_by_default:
        return config.listen
    default = DEFAULT_LISTENER
    bind = f"{default.scheme}://{default.host}:{default.port}"
    return (Listen.model_validate({"name": default.name, "bind": bind}),)


def only_part(listen: Listen) -> str | None:
    """Name the one line or upstream that a listener leads to; None for a listener that leads to all units."""
    return listen.line if listen.line is not None else listen.upstream


def leads_everywhere(config: Config) -> bool:
    """Tell whether a listener leads to all units, as the default listener does, or a server line serves all.

    Where no listener is wanted, units are for other ways in.
    """
    serves_all = any(line.serves == "all" for line in config.line)
    return not config.listen or serves_all or any(only_part(listen) is None for listen in config.listen)


def listeners_for(part: Line | Upstream, config: Config) -> list[Listen]:
    """List the listeners that lead to this line or upstream alone."""
    label = part.label
    return [listen for listen in config.listen if only_part(listen) == label]


def client_lines(config: Config) -> list[Line]:
    """List the lines on which the gateway is the client."""
    return [line for line in config.line if line.role == "client"]


def monitor_lines(config: Config) -> list[Line]:
    """List the lines on which the gateway only listens."""
    return [line for line in config.line if line.role == "monitor"]


def is_apart(line: Line, config: Config) -> bool:
    """Tell whether only its own listeners lead to a client line: it has no devices, and is not the only one."""
    has_company = any(other is not line for other in client_lines(config))
    return line.devices is None and has_company and bool(listeners_for(line, config))


def passing_units(config: Config) -> list[int]:
    """List the units of a pass-through line: all without another destination, and those that mirrors poll."""
    elsewhere = {image.unit for image in config.image if image.of is None}
    elsewhere |= {unit for upstream in config.upstream for row in rows_of(upstream) for unit in row.client_units}
    elsewhere |= set() if config.own is None else {config.own.unit}
    return [unit for unit in range(FIRST_UNIT, LAST_UNIT + 1) if unit not in elsewhere]


def own_units(line: Line, config: Config) -> frozenset[int]:
    """Find the units of a line without devices that only the listeners for it lead to."""
    if line.devices is not None or not listeners_for(line, config):
        return frozenset()
    every_unit = frozenset(range(FIRST_UNIT, LAST_UNIT + 1))
    return every_unit if is_apart(line, config) else every_unit.difference(passing_units(config))


def units_without_devices(line: Line, config: Config) -> list[int]:
    """List the units of a line without devices: those that pass through, and its own."""
    return sorted({*passing_units(config), *own_units(line, config)})


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
