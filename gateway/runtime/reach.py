"""The units that clients can reach, through any listener or through a listener for one line or upstream.

For most listeners, a unit identifier is the same unit for all clients. For a listener for one line it is an address on
that line, and for a listener for one upstream a unit of that server, whatever unit ID other clients use for it.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from gateway.config.plan.settings import ServerPlan
from gateway.devices.device import Device
from gateway.images.drivers.mirror_driver import MirrorDriver
from gateway.images.image import Image
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT
from gateway.request import NamedTarget
from gateway.routing.access import AS_NUMBERED, KnownAs
from gateway.routing.broadcast import Broadcast, Recipient
from gateway.routing.router import Router
from gateway.trace.ring import Ring

if TYPE_CHECKING:
    from gateway.runtime.build import Gateway


class Routing(NamedTuple):
    """A router, its routes, and the units for access rows that name no listener."""

    router: Router
    routes: Mapping[int, NamedTarget]
    known_as: KnownAs


class _Reach(NamedTuple):
    """The target of each unit identifier, the recipients of broadcasts, and the units for rows without listeners."""

    routes: Mapping[int, NamedTarget]
    recipients: Collection[Recipient]
    known_as: KnownAs


def routings(gateway: "Gateway") -> Iterator[Routing]:
    """The routes of all routers of a gateway."""
    plans, targets = gateway.plan.lines, _targets(gateway)
    on_lines = [Recipient(line.every_device, one.broadcasts) for line, one in zip(gateway.lines, plans, strict=True)]
    everyone = _everything(targets, [*on_lines, *map(_recipient, gateway.images)])
    alone = {
        one.line.name: _one_line(units.values(), recipient, targets)
        for one, units, recipient in zip(plans, gateway.devices, on_lines, strict=True)
    } | {
        upstream.name: _one_upstream([*upstream.devices.values(), *upstream.unnamed_of(one).values()], targets)
        for one, upstream in zip(gateway.plan.upstreams, gateway.upstreams, strict=True)
    }
    for router in (gateway.mqtt, gateway.sites, gateway.control, gateway.web):
        yield Routing(router, everyone.routes, everyone.known_as)
    for listener in gateway.listeners:
        settings = listener.settings
        reach = alone[settings.only] if settings.only else everyone
        yield Routing(listener.router, _routes_of_listener(settings, reach, gateway.ring), reach.known_as)
    for server in gateway.servers:
        yield Routing(server.router, _routes_of_server(server.plan, everyone, gateway.ring), everyone.known_as)


def _targets(gateway: "Gateway") -> dict[int, NamedTarget]:
    """What answers for each unit of listeners that are not for one line or upstream."""
    targets: dict[int, NamedTarget] = {image.settings.unit: image for image in gateway.images}
    for units, plan in zip(gateway.devices, gateway.plan.lines, strict=True):
        targets |= {unit: device for unit, device in units.items() if unit not in plan.own_units}
    for upstream in gateway.upstreams:
        targets |= upstream.devices
    targets |= {driver.mirror.settings.unit: driver for driver in gateway.mirrors}
    return targets


def _routes_of_listener(settings: ListenSettings, reach: _Reach, ring: Ring) -> Mapping[int, NamedTarget]:
    """Those it reaches; unit 0 is refused, goes to all recipients of broadcasts, or to another unit."""
    routes, unit0 = reach.routes, settings.unit0
    if unit0 == "broadcast":
        return {**routes, BROADCAST_UNIT: Broadcast(reach.recipients, ring)}
    return routes if unit0 == "refuse" else {**routes, BROADCAST_UNIT: routes[unit0]}


def _routes_of_server(plan: ServerPlan, reach: _Reach, ring: Ring) -> Mapping[int, NamedTarget]:
    """The units that a server line serves, and as unit 0 the recipients of its broadcasts."""
    served = {unit: reach.routes[unit] for unit in plan.line.serves}
    images = [_recipient(target) for target in served.values() if isinstance(target, Image)]
    recipients = {"images": images, "all": reach.recipients, "none": []}[plan.broadcast_to]
    return {**served, BROADCAST_UNIT: Broadcast(recipients, ring)}


def _recipient(image: Image) -> Recipient:
    return Recipient(image, image.settings.profile.broadcasts)


def _everything(routes: Mapping[int, NamedTarget], recipients: Collection[Recipient]) -> _Reach:
    """All units by their own numbers. Those above 247 count for broadcasts only if they exist."""
    known = [(unit,) if unit in routes else numbers for unit, numbers in enumerate(AS_NUMBERED)]
    return _Reach(routes, recipients, tuple(known))


def _one_line(devices: Collection[Device], recipient: Recipient, elsewhere: Mapping[int, NamedTarget]) -> _Reach:
    """The devices of a line by their addresses.

    For rows without listeners, an address that other clients cannot reach counts by its own number, unless another
    target has that; above 247 only if there is a device. Address 0 stands for devices without an address in the
    config, and for broadcasts.
    """
    known = _known_as(devices, elsewhere)
    reserved = (device.settings.unit for device in devices if device.settings.unit > LAST_UNIT)
    for address in (*range(FIRST_UNIT, LAST_UNIT + 1), *reserved):
        if not known[address] and address not in elsewhere:
            known[address].append(address)
    routes = {address: device for address, device in _by_own_number(devices).items() if address != BROADCAST_UNIT}
    return _Reach(routes, [recipient], tuple(map(tuple, known)))


def _one_upstream(devices: Collection[Device], elsewhere: Mapping[int, NamedTarget]) -> _Reach:
    """The units of another server by their numbers there.

    For rows without listeners, one that other clients cannot reach has no number.
    """
    return _Reach(_by_own_number(devices), [], tuple(map(tuple, _known_as(devices, elsewhere))))


def _by_own_number(devices: Collection[Device]) -> dict[int, NamedTarget]:
    """The devices by their numbers on the line or at the server; the first one if several have the same.

    A device that moves keeps the address in the config, as it keeps its unit.
    """
    return {device.settings.unit: device for device in reversed([*devices])}


def _known_as(devices: Collection[Device], elsewhere: Mapping[int, NamedTarget]) -> list[list[int]]:
    """The units by which other clients reach each number through `elsewhere`: its own, or those of mirrors."""
    known: list[list[int]] = [[] for _ in AS_NUMBERED]
    for device in devices:
        own = device.settings.known_as
        known[device.settings.unit] += [own] if elsewhere.get(own) is device else _mirrors_of(device, elsewhere)
    return known


def _mirrors_of(device: Device, routes: Mapping[int, NamedTarget]) -> list[int]:
    """The units of the mirrors of a device."""
    return [unit for unit, target in routes.items() if isinstance(target, MirrorDriver) and target.device is device]
