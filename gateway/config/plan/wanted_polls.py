"""Who wants to have polled what of the devices, as the config says."""

from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

from gateway.config.plan.settings import Plan
from gateway.config.values.reserved_names import MQTT
from gateway.images.polls import Poll


class WantedPoll(NamedTuple):
    """What one point, or one row of the config, wants of the device named `of`. `trace` shows `by` as the client."""

    by: str
    of: str
    poll: Poll
    is_point: bool


def wanted_polls(plan: Plan, devices: Collection[str]) -> Mapping[str, tuple[WantedPoll, ...]]:
    """Find all that mirrors, virtual units and MQTT want to have polled of the devices with these names, by these.

    What is only heard is not polled.
    """
    found: dict[str, list[WantedPoll]] = {}
    for wanted in (*_of_mirrors(plan, devices), *_of_virtual_units(plan, devices), *_of_mqtt(plan, devices)):
        if wanted.poll.every:
            found.setdefault(wanted.of, []).append(wanted)
    return {name: tuple(each) for name, each in found.items()}


def _of_mirrors(plan: Plan, devices: Collection[str]) -> Iterator[WantedPoll]:
    for mirror in plan.mirrors:
        for poll in mirror.wanted if mirror.of in devices else ():
            yield WantedPoll(mirror.label, mirror.of, poll, is_point=False)


def _of_virtual_units(plan: Plan, devices: Collection[str]) -> Iterator[WantedPoll]:
    for unit in plan.virtual:
        for value in unit.values:
            if value.device in devices:
                yield WantedPoll(unit.label, value.device, value.poll, is_point=value.point is not None)


def _of_mqtt(plan: Plan, devices: Collection[str]) -> Iterator[WantedPoll]:
    for device in plan.mqtt.devices if plan.mqtt else ():
        for each in device.points if device.name in devices else ():
            if each.is_readable:
                yield WantedPoll(MQTT, device.name, Poll.of(each.point, each.every), is_point=True)
