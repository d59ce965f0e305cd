"""Plain messages: one JSON object for the values of each device, and text for all else."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final

from gateway.clock.times import rfc_3339
from gateway.plant.messages import (
    Command,
    Delivery,
    DeviceState,
    Message,
    Misdirected,
    Reading,
    Readings,
    Rebirth,
    Received,
    Record,
)
from gateway.plant.topics import Topics
from gateway.profiles.published import PublishedDevice, PublishedPoint

ONLINE: Final = b"online"
OFFLINE: Final = b"offline"
#: The longest value that is accepted, in bytes: a string of 125 registers has 250.
LONGEST_VALUE: Final = 256
#: Values for longer topics than this, in characters, are ignored.
LONGEST_TOPIC: Final = 1000


class PlainForm:
    """The form of the messages of a site that publishes `devices`.

    `announcements` are published at each birth, before anything else; a host that needs them publishes `online` on one
    of the topics `hosts` when it has started.
    """

    is_held = False
    leaves_with_will = False

    takes_commands_first = False

    def __init__(
        self,
        topics: Topics,
        devices: Sequence[PublishedDevice],
        announcements: Sequence[Message] = (),
        hosts: Sequence[str] = (),
    ) -> None:
        self._topics = topics
        self._announcements = announcements
        self._hosts = hosts
        self._devices = {device.name: device for device in devices}
        self._has_settable = any(point.point.write != "no" for device in devices for point in device.points)

    def will(self, at: float) -> Message:  # noqa: ARG002 - the broker cannot know when it publishes it
        """Return the message that the gateway is offline."""
        return Message(self._topics.status, OFFLINE, retain=True)

    def early_subscriptions(self) -> Sequence[str]:
        """Return nothing: a birth is never held."""
        return ()

    def command_subscriptions(self) -> Sequence[str]:
        """Return the topics of hosts, and the filter of all that set points, if a profile lets a point be written.

        The filter includes devices and points that cannot be set, so that an attempt gets a result.
        """
        return (*((self._topics.settings,) if self._has_settable else ()), *self._hosts)

    def born(self, states: Iterable[DeviceState], at: float) -> Iterable[Message]:
        """Yield the announcements, each device with its known readings, and then that the gateway is online."""
        yield from self._announcements
        for state in states:
            yield from self.availability(state, at)
        yield Message(self._topics.status, ONLINE, retain=True)

    def values(
        self,
        device: PublishedDevice,
        readings: Readings,
        changed: Collection[str],
        at: float,
    ) -> Sequence[Message]:
        """Return one message with all values of the device; its time is that of the latest new one.

        If some are taken back that is now.
        """
        values = {name: reading.value for name, reading in readings.items()}
        new = {name: readings[name] for name in changed if name in readings}
        if new and len(new) == len(changed):
            at = max(new.values(), key=lambda reading: reading.read_at).at  # the clock may have been set
        told = {name: Reading(reading.value, round(at, 3)) for name, reading in new.items()}
        return (self._json(self._topics.values(device.name), at, values, retain=True, device=device.name, told=told),)

    def availability(self, state: DeviceState, at: float) -> Sequence[Message]:
        """Return the device's readings, if it has any, and then whether it answers."""
        device = state.device
        values = self.values(device, state.readings, state.readings, at) if state.readings else ()
        payload = ONLINE if state.is_available else OFFLINE
        return (*values, Message(self._topics.availability(device.name), payload, retain=True, device=device.name))

    def may_tell(self, device: str) -> bool:  # noqa: ARG002 - all alike
        """Return True: each message stands for itself."""
        return True

    def history(self, device: str, records: Sequence[Record], at: float) -> Message | None:  # noqa: ARG002
        """Return one message with a JSON array of the records."""
        content = [_told(each) for each in records]
        text = json.dumps(content, ensure_ascii=False, allow_nan=False)
        return Message(self._topics.history(device), text.encode())

    def received(self, delivery: Delivery) -> Sequence[Received]:
        """Return a write to a point, or a Rebirth if a host has started.

        An empty retained message asks for nothing: it only deletes an earlier one.
        """
        if delivery.topic in self._hosts:
            return (Rebirth(),) if delivery.payload == ONLINE else ()
        names = self._topics.named(delivery.topic) if len(delivery.topic) <= LONGEST_TOPIC else None
        if names is None or (delivery.is_retained and not delivery.payload):
            return ()
        device_name, point_name = names
        device = self._devices.get(device_name)
        point = None if device is None else device.point(point_name)
        if device is not None and point is not None and point.is_writable:
            return (_command(device, point, delivery),)
        return (_misdirected(device, device_name, point_name, delivery),)

    def result(self, command: Command | Misdirected, error: str | None, at: float) -> Sequence[Message]:
        """Return the result of a command as a message: `ok`, or `failed` and the reason."""
        topic = self._topics.result(command.delivery.topic)
        outcome = {"result": "ok"} if error is None else {"result": "failed", "reason": error}
        correlation = command.delivery.correlation
        return (self._json(topic, at, {"value": command.text, **outcome}, correlation=correlation),)

    def ended(self, at: float) -> Sequence[Message]:
        """Return the message that the gateway is offline."""
        return (self.will(at),)

    def _json(self, topic: str, at: float, content: Mapping[str, Any], **options: Any) -> Message:
        text = json.dumps({"time": rfc_3339(at), **content}, ensure_ascii=False, allow_nan=False)
        return Message(topic, text.encode(), **options)


def gone(topic: str) -> Sequence[Message]:
    """Return the messages for a device that is no longer published: offline, and without values at the broker.

    `topic` is the topic of its values.
    """
    return (
        Message(Topics.availability_of(topic), OFFLINE, retain=True),
        Message(topic, b"", retain=True),
    )


def _told(record: Record) -> Mapping[str, Any]:
    """Make the object of a record. A point that was kept for Sparkplug may be called `time`; here that is its time."""
    values = {name: value for name, value in record.values.items() if name != "time"}
    return {"time": rfc_3339(record.at), **values, **({"clock": "unsure"} if record.is_unsure else {})}


def _command(device: PublishedDevice, point: PublishedPoint, delivery: Delivery) -> Command:
    try:
        text = delivery.payload[:LONGEST_VALUE].decode()
    except UnicodeDecodeError:
        return Command(device, point, "", delivery, "this is no text")
    if len(delivery.payload) > LONGEST_VALUE:
        return Command(device, point, text, delivery, f"this has more than {LONGEST_VALUE} bytes")
    if point.point.type == "string":
        return Command(device, point, text, delivery)
    return Command(device, point, text.strip(), delivery)


def _misdirected(device: PublishedDevice | None, device_name: str, point_name: str, delivery: Delivery) -> Misdirected:
    text = delivery.payload[:LONGEST_VALUE].decode(errors="replace")
    if device is None:
        return Misdirected(text, delivery, f"no device {device_name} is published")
    point = device.point(point_name)
    if point is None:
        return Misdirected(text, delivery, f"{device_name} has no point {point_name}")
    missing = "" if point.point.write == "no" else ": the gateway's [mqtt] has no write = true"
    return Misdirected(text, delivery, f"{point_name} must not be written{missing}")
