"""What devices and units are called: the names that a config gives them, or those that follow from their tables."""

from gateway.config.schema.line import Device, Line
from gateway.config.schema.upstream import Upstream, UpstreamUnit
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT


def device_names(line: Line, row: Device) -> list[str]:
    """Name the devices of a row, in the order of its units."""
    if row.name is None:
        return [f"{line.label}/{unit}" for unit in row.client_units]
    return [row.name.replace("*", str(unit)) for unit in row.client_units]


def all_device_names(line: Line) -> list[str]:
    """Name all devices of a line; of a line without devices, all units that may be on it."""
    if line.devices is None:
        return [f"{line.label}/{unit}" for unit in range(FIRST_UNIT, LAST_UNIT + 1)]
    return [name for row in line.devices for name in device_names(line, row)]


def unit_names(upstream: Upstream, row: UpstreamUnit) -> list[str]:
    """Name the units of a row, in the order of its units."""
    return [f"{upstream.label}/{unit}" for unit in row.known_as]


def unlisted_units(upstream: Upstream) -> dict[int, str]:
    """Find the units of the server that no row lists, each with its name."""
    listed = {unit for row in upstream.units or () for unit in row.units}
    taken = {unit for row in upstream.units or () for unit in row.known_as}
    return {
        unit: f"{upstream.label}/unit-{unit}" if unit in taken else f"{upstream.label}/{unit}"
        for unit in range(256)
        if unit not in listed
    }
