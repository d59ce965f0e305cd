"""Whom clients can ask, through any listener and through one for one line.

Through most listeners a unit identifier is a unit that every client knows. Through a listener for one line it is an
address on that line's wire, whatever other clients call the device there.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from gateway.devices.device import Device
from gateway.images.mirror_driver import MirrorDriver
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT, SERVER_UNIT
from gateway.request import Target
from gateway.routing.access import AS_NUMBERED, KnownAs
from gateway.routing.broadcast import Recipient


class Reach(NamedTuple):
    """Where each unit identifier leads, who takes broadcasts, and by which units rows without listeners count."""

    routes: Mapping[int, Target]
    recipients: Collection[Recipient]
    known_as: KnownAs


def everything(routes: Mapping[int, Target], recipients: Collection[Recipient]) -> Reach:
    """Every unit is known by its own number; whoever answers for 255 takes broadcasts too."""
    is_served = SERVER_UNIT in routes
    return Reach(routes, recipients, (*AS_NUMBERED[:SERVER_UNIT], (SERVER_UNIT,)) if is_served else AS_NUMBERED)


def one_line(devices: Collection[Device], recipient: Recipient, elsewhere: Mapping[int, Target]) -> Reach:
    """The devices of a line by their addresses in the config, the first one where several have the same.

    A device that moves keeps the address that the config names, as it keeps its unit.
    """
    routes: dict[int, Target] = {}
    for device in devices:
        if device.settings.unit != BROADCAST_UNIT:
            routes.setdefault(device.settings.unit, device)
    return Reach(routes, [recipient], _known_as(devices, elsewhere))


def _known_as(devices: Collection[Device], elsewhere: Mapping[int, Target]) -> KnownAs:
    """By which units the routes of all other clients, `elsewhere`, lead to each address: by its own, or by mirrors.

    An address to which none leads counts by its own number, unless somebody else has that. At address 0 are devices
    that have no address in the config, and take broadcasts.
    """
    known: list[list[int]] = [[] for _ in AS_NUMBERED]
    for device in devices:
        own = device.settings.known_as
        known[device.settings.unit] += [own] if elsewhere.get(own) is device else _mirrors_of(device, elsewhere)
    for address in range(FIRST_UNIT, LAST_UNIT + 1):
        if not known[address] and address not in elsewhere:
            known[address].append(address)
    return tuple(map(tuple, known))


def _mirrors_of(device: Device, routes: Mapping[int, Target]) -> list[int]:
    """The units of the mirrors that pass on to a device what they cannot answer themselves."""
    return [unit for unit, target in routes.items() if isinstance(target, MirrorDriver) and target.device is device]
