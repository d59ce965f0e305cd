"""The units that clients can reach, through any listener or through a listener for one line or upstream.

For most listeners, a unit identifier is the same unit for all clients. For a listener for one line it is an address on
that line, and for a listener for one upstream a unit of that server, whatever unit ID other clients use for it.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from gateway.config.plan.settings import ServerPlan
from gateway.devices.device import Device
from gateway.images.drivers.unit_driver import UnitDriver
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.virtual.unit import VirtualUnit
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT
from gateway.request import NamedTarget
from gateway.routing.access import AS_NUMBERED, NO_UNIT, KnownAs
from gateway.routing.broadcast import Broadcast, Recipient
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway, Reach
from gateway.trace.ring import Ring


class _Reach(NamedTuple):
    """The target of each unit identifier, the recipients of broadcasts, and the units for rows without listeners.

    Devices without a unit for clients are there by their `key_of`: no listener leads to these.
    """

    routes: Mapping[int, NamedTarget]
    recipients: Collection[Recipient]
    known_as: KnownAs


def with_routes(gateway: Gateway, ring: Ring) -> Gateway:
    """Add to a gateway what clients reach. Broadcasts are recorded in `ring`."""
    plans, targets = gateway.plan.lines, _targets(gateway)
    on_lines = [Recipient(line.every_device, one.broadcasts) for line, one in zip(gateway.lines, plans, strict=True)]
    everyone = _everything(targets, [*on_lines, *map(_recipient, gateway.tables)])
    alone = {
        one.line.name: _one_line(units.values(), recipient, targets)
        for one, units, recipient in zip(plans, gateway.devices, on_lines, strict=True)
    } | {
        upstream.name: _one_upstream([*upstream.devices.values(), *upstream.unnamed_of(one).values()], targets)
        for one, upstream in zip(gateway.plan.upstreams, gateway.upstreams, strict=True)
    }
    return replace(
        gateway,
        everywhere=Reach(everyone.routes, everyone.known_as),
        routings=(*_of_listeners(gateway, everyone, alone, ring), *_of_servers(gateway, everyone, ring)),
    )


def _of_listeners(
    gateway: Gateway, everyone: _Reach, alone: Mapping[str, _Reach], ring: Ring
) -> Iterator[tuple[Router, Reach]]:
    for listener in gateway.listeners:
        settings = listener.settings
        reach = alone[settings.only] if settings.only else everyone
        yield listener.router, Reach(_routes_of_listener(settings, reach, ring), reach.known_as)


def _of_servers(gateway: Gateway, everyone: _Reach, ring: Ring) -> Iterator[tuple[Router, Reach]]:
    for server, plan in zip(gateway.servers, gateway.plan.servers, strict=True):
        yield server.router, Reach(_routes_of_server(plan, everyone, ring), everyone.known_as)


def _targets(gateway: Gateway) -> dict[int, NamedTarget]:
    """Find what answers for each unit of listeners that are not for one line or upstream."""
    targets: dict[int, NamedTarget] = {image.settings.unit: image for image in gateway.images}
    for units, plan in zip(gateway.devices, gateway.plan.lines, strict=True):
        targets |= {unit: device for unit, device in units.items() if unit not in plan.own_units}
    for upstream in gateway.upstreams:
        targets |= upstream.devices
    for monitor in gateway.monitors:
        targets |= monitor.devices
    targets |= {driver.unit.settings.unit: driver for driver in gateway.polling_units}
    return targets


def _routes_of_listener(settings: ListenSettings, reach: _Reach, ring: Ring) -> Mapping[int, NamedTarget]:
    """Add unit 0 to what it reaches: it is refused, goes to all recipients of broadcasts, or to another unit."""
    routes, unit0 = reach.routes, settings.unit0
    if unit0 == "broadcast":
        return {**routes, BROADCAST_UNIT: Broadcast(reach.recipients, ring)}
    return routes if unit0 == "refuse" else {**routes, BROADCAST_UNIT: routes[unit0]}


def _routes_of_server(plan: ServerPlan, reach: _Reach, ring: Ring) -> Mapping[int, NamedTarget]:
    """Choose the units that a server line serves, and as unit 0 the recipients of its broadcasts."""
    served = {unit: reach.routes[unit] for unit in plan.line.serves}
    images = [_recipient(image) for target in served.values() if (image := _image_of(target)) is not None]
    recipients = {"images": images, "all": reach.recipients, "none": []}[plan.broadcast_to]
    return {**served, BROADCAST_UNIT: Broadcast(recipients, ring)}


def _image_of(target: NamedTarget) -> Image | None:
    """Find the image that a target is, or that has the own registers of a virtual unit."""
    if isinstance(target, UnitDriver) and isinstance(target.unit, VirtualUnit):
        return target.unit.own
    return target if isinstance(target, Image) else None


def _recipient(image: Image) -> Recipient:
    return Recipient(image, image.settings.profile.broadcasts)


def _everything(routes: Mapping[int, NamedTarget], recipients: Collection[Recipient]) -> _Reach:
    """Reach all units by their own numbers. Those above 247 count for broadcasts only if they exist."""
    known = [(unit,) if unit in routes else numbers for unit, numbers in enumerate(AS_NUMBERED)]
    if any(unit > HIGHEST_UNIT for unit in routes):
        known[NO_UNIT] = (NO_UNIT,)
    return _Reach(routes, recipients, tuple(known))


def _one_line(devices: Collection[Device], recipient: Recipient, elsewhere: Mapping[int, NamedTarget]) -> _Reach:
    """Reach the devices of a line by their addresses.

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
    """Reach the units of another server by their numbers there.

    For rows without listeners, one that other clients cannot reach has no number.
    """
    return _Reach(_by_own_number(devices), [], tuple(map(tuple, _known_as(devices, elsewhere))))


def _by_own_number(devices: Collection[Device]) -> dict[int, NamedTarget]:
    """Sort devices by their numbers on the line or at the server; the first one counts if several have the same.

    A device that moves keeps the address in the config, as it keeps its unit.
    """
    return {device.settings.unit: device for device in reversed([*devices])}


def _known_as(devices: Collection[Device], elsewhere: Mapping[int, NamedTarget]) -> list[list[int]]:
    """Find the units by which other clients reach each number through `elsewhere`: its own, or those of mirrors."""
    known: list[list[int]] = [[] for _ in AS_NUMBERED]
    for device in devices:
        known[device.settings.unit] += _units_of(device, elsewhere)
    return known


def _units_of(device: Device, elsewhere: Mapping[int, NamedTarget]) -> list[int]:
    """Find the units by which other clients reach a device; NO_UNIT if that is by its name only."""
    own = device.settings.client_unit
    if own is None:
        return [NO_UNIT]
    return [own] if elsewhere.get(own) is device else _mirrors_of(device, elsewhere)


def _mirrors_of(device: Device, routes: Mapping[int, NamedTarget]) -> list[int]:
    """Find the units of the mirrors of a device."""
    return [unit for unit, target in routes.items() if _is_mirror(target, device)]


def _is_mirror(target: NamedTarget, device: Device) -> bool:
    return isinstance(target, UnitDriver) and isinstance(target.unit, Mirror) and target.unit.device is device
