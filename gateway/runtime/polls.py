"""What supplies the values of a unit: polls of a device or of what the gateway answers itself, or what is heard."""

from gateway.devices.device import Device
from gateway.devices.heard import HeardDevice
from gateway.images.drivers.heard_driver import HeardDriver
from gateway.images.drivers.polls_driver import Pollers, PollsDriver
from gateway.images.drivers.unit_driver import UnitDriver
from gateway.images.image import Image
from gateway.images.polling import PolledUnit
from gateway.images.virtual.settings import VirtualSettings
from gateway.profiles.read_rules import ReadRules
from gateway.request import Target


def supply_of(target: Target, pollers: Pollers) -> PollsDriver | HeardDriver:
    """Return the polls of a unit, or what is heard of it if others ask it: the same for all that want its values."""
    return pollers.heard(target) if isinstance(target, HeardDevice) else polls_of(target, pollers)


def polls_of(target: Target, pollers: Pollers) -> PollsDriver:
    """Return the polls of a device, an image, a mirror or a virtual unit: the same for all that want them."""
    if isinstance(target, Device):
        device = target.settings
        unit = device.unit if device.client_unit is None else device.client_unit
        return pollers.of(target, PolledUnit(device.name, unit, ReadRules.of(device.profile)), target.line_name)
    assert isinstance(target, Image | UnitDriver)  # noqa: S101 - nothing else is polled
    own = target.settings if isinstance(target, Image) else target.unit.settings
    # What the gateway answers itself costs nothing to ask, and has its own addresses only.
    rules, is_virtual = ReadRules(own.profile.limits), isinstance(own, VirtualSettings)
    return pollers.at_once(target, PolledUnit(own.name, own.unit, rules, many_sources=is_virtual))
