"""The last reads of devices that have points, over a reload."""

from gateway.lines.last_reads import LastReads
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine


def keep_reads(before: Gateway, now: Gateway) -> None:
    """Let devices with points remember their last reads, and go on with those from `before` if they are the same.

    A device is the same if its name, its unit on the wire, its line and the port of that are.
    """
    owners = {owner.name: owner for owner in before.owners}
    for owner in now.owners:
        was = owners.get(owner.name)
        is_same = was is not None and was.plan.port == owner.plan.port
        known = _reads(was) if was is not None and is_same else {}
        for device in owner.devices.values():
            key = device.settings.known_as
            is_own = isinstance(owner, GatewayLine) and key in owner.plan.own_units
            points = () if is_own else now.plan.points.get(key, ())
            if not points:
                device.last_reads = None
                continue
            device.last_reads = known.get((device.name, device.settings.unit)) or LastReads()
            device.last_reads.expect(len(points))


def _reads(owner: Owner) -> dict[tuple[str, int], LastReads]:
    devices = ((each, each.last_reads) for each in owner.devices.values())
    return {(device.name, device.settings.unit): reads for device, reads in devices if reads is not None}
