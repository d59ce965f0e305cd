"""The last reads of devices that have points, over a reload."""

from gateway.devices.device import Device
from gateway.lines.last_reads import LastReads
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine


def keep_reads(before: Gateway, now: Gateway) -> None:
    """Let devices with points remember their last reads, and go on with those from `before` if they are the same.

    A device is the same if its name, its unit on the wire, its line and the port of that are. Devices of one line with
    the same unit on the wire are one: what is written by way of the one changes the other.
    """
    owners = {owner.name: owner for owner in before.owners}
    for owner in now.owners:
        was = owners.get(owner.name)
        is_same = was is not None and was.plan.port == owner.plan.port
        known = _reads(was) if was is not None and is_same else {}
        by_unit: dict[int, LastReads] = {}
        for device in owner.devices.values():
            if count := _points(now, owner, device):
                unit = device.settings.unit
                reads = by_unit.get(unit) or known.get((device.name, unit)) or LastReads()
                reads.expect(count)
                by_unit[unit] = reads
        for device in owner.devices.values():
            device.last_reads = by_unit.get(device.settings.unit)


def _points(gateway: Gateway, owner: Owner, device: Device) -> int:
    key = device.settings.known_as
    is_own = isinstance(owner, GatewayLine) and key in owner.plan.own_units
    return 0 if is_own else len(gateway.plan.points.get(key, ()))


def _reads(owner: Owner) -> dict[tuple[str, int], LastReads]:
    devices = ((each, each.last_reads) for each in owner.devices.values())
    return {(device.name, device.settings.unit): reads for device, reads in devices if reads is not None}
