"""Retained discovery messages of one plan: they announce present devices, and clear removed ones.

Earlier announcements, of any site and form, are cleared once they are no longer made.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from gateway.clock.threads import in_thread
from gateway.config.plan.settings import MqttPlan
from gateway.plant.discovery import Announced, Discovery
from gateway.plant.messages import Message
from gateway.plant.plain import gone
from gateway.plant.topics import Topics
from gateway.runtime.mqtt.announced import AnnouncedDevices

#: The entry of a device whose last values a broker keeps, in the list of what was announced.
_PLAIN: Final[Mapping[str, str]] = {"": "plain"}


class Announcing:
    """The `messages` to publish in each connection; the list `announced` has them before they are published."""

    def __init__(self, messages: Sequence[Message], now: Announced, announced: AnnouncedDevices) -> None:
        self.messages = messages
        self._now = now
        self._announced = announced
        announced.add(now)

    @classmethod
    async def of(cls, plan: MqttPlan, announced: AnnouncedDevices) -> "Announcing":
        """Make the messages of a plan, in a thread: there may be thousands of points."""
        return cls(*await in_thread("announce", _made, plan, announced.entries()), announced)

    def withdrawal(self) -> list[Message]:
        """List the messages that clear all that was announced."""
        return list(_taken_back(self._announced.entries(), {}))

    def done(self) -> None:
        """Note that the messages have been published."""
        self._announced.replace(self._now)

    def withdrawn(self) -> None:
        """Note that all of it has been cleared."""
        self._announced.replace({})


def _made(plan: MqttPlan, before: Announced) -> tuple[Sequence[Message], Announced]:
    """Make the messages, and the list of what they announce."""
    topics = Topics(plan.site, plan.prefix)
    discovery = Discovery(topics, plan.home_assistant or "")
    found = () if plan.home_assistant is None else plan.devices
    now = dict(discovery.announced(found))
    if plan.sparkplug is None:
        now |= {topics.values(device.name): _PLAIN for device in plan.devices}
    return [*_taken_back(before, now), *discovery.messages(found, before)], now


def _taken_back(before: Announced, now: Announced) -> Iterator[Message]:
    for topic, entry in before.items():
        if topic not in now:
            yield from gone(topic) if entry == _PLAIN else (Message(topic, b"", retain=True),)
