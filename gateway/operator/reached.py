"""What answers for a unit, and which clients may ask it."""

from gateway.devices.device import Device
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.virtual.unit import VirtualUnit
from gateway.profiles.holes import Holes
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_upstream import GatewayUpstream

#: What the gateway itself answers for.
Held = Image | Mirror | VirtualUnit


def may(router: Router, host: str, unit: int, function: int) -> bool:
    """Return whether [[access]] lets a client at this address use a function of a unit, through this router."""
    right = router.rights.everywhere(host, unit)
    return function in right or bytes((function,)) in right


def target(gateway: Gateway, unit: int) -> object:
    """Find what answers for a unit: the same object until a reload replaces it; None if nothing does."""
    return device_of(gateway, unit) or image_of(gateway, unit)


def device_of(gateway: Gateway, unit: int) -> Device | None:
    """Find the device that every client knows by this number, not one reached only by a listener for its line."""
    for line in gateway.lines:
        if unit in line.devices and unit not in line.plan.own_units:
            return line.devices[unit]
    others: tuple[GatewayUpstream | GatewayMonitor, ...] = (*gateway.upstreams, *gateway.monitors)
    return next((each.devices[unit] for each in others if unit in each.devices), None)


def holes_of(gateway: Gateway, unit: int) -> Holes:
    """Return what a unit has refused to be read together; nothing is known of one that is no device."""
    device = device_of(gateway, unit)
    return Holes() if device is None else device.holes


def image_of(gateway: Gateway, unit: int) -> Held | None:
    """Find the image, mirror or virtual unit with this number."""
    images: tuple[Held, ...] = (*gateway.images, *(driver.unit for driver in gateway.polling_units))
    return next((image for image in images if image.settings.unit == unit), None)
