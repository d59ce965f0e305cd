"""The units that clients can reach, through any listener or through a listener for one line.

For most listeners, a unit identifier is the same unit for all clients. For a listener for one line it is an address on
that line, whatever unit ID other clients use for that device.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from gateway.devices.device import Device
from gateway.images.mirror_driver import MirrorDriver
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT, SERVER_UNIT
from gateway.request import NamedTarget
from gateway.routing.access import AS_NUMBERED, KnownAs
from gateway.routing.broadcast import Recipient


class Reach(NamedTuple):
    """The target of each unit identifier, the recipients of broadcasts, and the units for rows without listeners."""

    routes: Mapping[int, NamedTarget]
    recipients: Collection[Recipient]
    known_as: KnownAs


def everything(routes: Mapping[int, NamedTarget], recipients: Collection[Recipient]) -> Reach:
    """All units by their own numbers; the target of unit 255 takes broadcasts too."""
    is_served = SERVER_UNIT in routes
    return Reach(routes, recipients, (*AS_NUMBERED[:SERVER_UNIT], (SERVER_UNIT,)) if is_served else AS_NUMBERED)


def one_line(devices: Collection[Device], recipient: Recipient, elsewhere: Mapping[int, NamedTarget]) -> Reach:
    """The devices of a line by their addresses in the config; the first one if several have the same.

    A device that moves keeps the address in the config, as it keeps its unit.
    """
    routes: dict[int, NamedTarget] = {}
    for device in devices:
        if device.settings.unit != BROADCAST_UNIT:
            routes.setdefault(device.settings.unit, device)
    return Reach(routes, [recipient], _known_as(devices, elsewhere))


def _known_as(devices: Collection[Device], elsewhere: Mapping[int, NamedTarget]) -> KnownAs:
    """The units by which other clients reach each address through `elsewhere`: its own, or those of mirrors.

    An address that they cannot reach counts by its own number, unless another target has that. Address 0 stands for
    devices without an address in the config, and for broadcasts.
    """
    known: list[list[int]] = [[] for _ in AS_NUMBERED]
    for device in devices:
        own = device.settings.known_as
        known[device.settings.unit] += [own] if elsewhere.get(own) is device else _mirrors_of(device, elsewhere)
    for address in range(FIRST_UNIT, LAST_UNIT + 1):
        if not known[address] and address not in elsewhere:
            known[address].append(address)
    return tuple(map(tuple, known))


def _mirrors_of(device: Device, routes: Mapping[int, NamedTarget]) -> list[int]:
    """The units of the mirrors of a device."""
    return [unit for unit, target in routes.items() if isinstance(target, MirrorDriver) and target.device is device]
