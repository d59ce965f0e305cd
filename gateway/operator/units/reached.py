"""What answers for a unit, and what clients may read of it."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from gateway.config.values.ranges import MOST_ITEMS, join_ranges
from gateway.devices.device import Device
from gateway.images.custom_image import CustomImage
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitHead
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.profiles.holes import Holes
from gateway.registers.items import read_request
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine

L = TypeVar("L", bound=Owner)

#: What the gateway itself answers for.
Held = Image | Mirror | VirtualUnit


class Readable:
    """What [[access]] lets a client at the address `host` read of a unit through a router; `areas` are whole ones."""

    def __init__(self, router: Router, host: str, unit: int) -> None:
        self._rights, self._host, self._unit = router.rights, host, unit
        everywhere = router.rights.everywhere(host, unit)
        self.areas = frozenset(area for area, (function, _) in READERS.items() if function in everywhere)

    def has(self, span: Span) -> bool:
        """Return whether all addresses of a span may be read."""
        return span.area in self.areas or self._rights.permits(self._host, self._unit, read_request(span))

    def parts(self, span: Span) -> Sequence[Span]:
        """List the parts of a span that may be read; it should not be long."""
        if span.area in self.areas:
            return [span]
        last = min(span.end, MOST_ITEMS)
        found = (at for at in range(span.start, last) if self.has(Span(span.area, at, 1)))
        return [Span(span.area, first, end - first + 1) for first, end in join_ranges((at, at) for at in found)]


def readable_for(operator: Operator, unit: UnitHead, asker: Asker) -> Readable:
    """Return what an asker may read of a unit through the door that it uses."""
    return Readable(operator.router(asker.door), asker.host, unit.key)


class ReadableHoles(Holes):
    """The `holes` of a device, and as further ones what a client may not read."""

    def __init__(self, holes: Holes, readable: Readable) -> None:
        self._holes = holes
        self._readable = readable

    def add(self, hole: Span) -> None:
        """Remember a hole that the device has refused."""
        self._holes.add(hole)

    def refuse(self, hole: Span) -> bool:
        """Return whether it must not be read with what is around it."""
        return not self._readable.has(hole) or self._holes.refuse(hole)


def target(gateway: Gateway, unit: int) -> object:
    """Find what answers for a unit: the same object until a reload replaces it; None if nothing does."""
    return device_of(gateway, unit) or held_of(gateway, unit)


def device_of(gateway: Gateway, unit: int) -> Device | None:
    """Find the device that every client knows by this number, not one reached only by a listener for its line."""
    owner = owner_of(gateway.owners, unit)
    return None if owner is None or _is_own(owner, unit) else owner.devices[unit]


def owner_of(owners: Iterable[L], unit: int) -> L | None:
    """Find the line or upstream with the device that every client knows by this number.

    Else the first line where it is an address; None if there is none.
    """
    return min((each for each in owners if unit in each.devices), key=lambda each: _is_own(each, unit), default=None)


def _is_own(owner: Owner, unit: int) -> bool:
    """Tell whether only a listener for a line leads to its device with this number."""
    return isinstance(owner, GatewayLine) and unit in owner.plan.own_units


def holes_of(gateway: Gateway, unit: int) -> Holes:
    """Return what a unit has refused to be read together; nothing is known of one that is no device."""
    device = device_of(gateway, unit)
    return Holes() if device is None else device.holes


def image_of(gateway: Gateway, unit: int) -> Held | None:
    """Find the image, mirror or virtual unit with this number. One that is made in Python is none: it has no values."""
    found = held_of(gateway, unit)
    return None if isinstance(found, CustomImage) else found


def held_of(gateway: Gateway, unit: int) -> Held | None:
    """Find what the gateway itself answers for this unit with."""
    images: tuple[Held, ...] = (*gateway.images, *(driver.unit for driver in gateway.polling_units))
    return next((image for image in images if image.settings.unit == unit), None)
