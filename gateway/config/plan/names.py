"""What devices are called: the names that a config gives them, or those that follow from their tables."""

from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.upstream import Upstream
from gateway.devices.device import key_of
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT

#: A part of the config that has devices.
Owner = Line | Upstream


def owners(config: Config) -> list[Owner]:
    """List the parts with devices: lines on which the gateway is the client, upstreams, and monitor lines."""
    clients, monitors = ([line for line in config.line if line.role == role] for role in ("client", "monitor"))
    return [*clients, *config.upstream, *monitors]


def heard_on(config: Config) -> dict[str, str]:
    """Find the devices that only others ask, each with the name of its monitor line."""
    monitors = [line for line in config.line if line.role == "monitor"]
    return {name: line.label for line in monitors for row in rows_of(line) for name in device_names(line, row)}


def rows_of(owner: Owner) -> tuple[Device, ...]:
    """Give the rows of a line or upstream that describe its devices."""
    return (owner.devices if isinstance(owner, Line) else owner.units) or ()


def device_names(owner: Owner, row: Device) -> list[str]:
    """Name the devices of a row, in the order of its units."""
    if row.name is None:
        return [f"{owner.label}/{number}" for number in row.numbers]
    return [row.name.replace("*", str(number)) for number in row.numbers]


def keys_of(owner: Owner, row: Device) -> list[int]:
    """Give the numbers of the devices of a row within the gateway: those for clients, or what stands in their place."""
    return [*row.client_units] or [key_of(name) for name in device_names(owner, row)]


def all_device_names(line: Line) -> list[str]:
    """Name all devices of a line; of a line without devices, all units that may be on it."""
    if line.devices is None:
        return [f"{line.label}/{unit}" for unit in range(FIRST_UNIT, LAST_UNIT + 1)]
    return [name for row in line.devices for name in device_names(line, row)]


def unlisted_units(upstream: Upstream) -> dict[int, str]:
    """Find the units of the server that no row lists, each with its name."""
    listed = {unit for row in rows_of(upstream) for unit in row.units}
    taken = {name for row in rows_of(upstream) for name in device_names(upstream, row)}
    names = {unit: f"{upstream.label}/{unit}" for unit in range(256) if unit not in listed}
    return {unit: f"{upstream.label}/unit-{unit}" if name in taken else name for unit, name in names.items()}
