"""Metrics of what is published."""

from collections.abc import Iterator

from gateway.observe.families import Family
from gateway.plant.status import BrokerStatus


def metrics_of(mqtt: BrokerStatus | None) -> Iterator[Family]:
    """Count messages, commands and polls; nothing without [mqtt]."""
    if mqtt is None:
        return
    up = Family("gauge", "broker_up", "Whether values are published at the MQTT broker.")
    up.add(mqtt.state == "up")
    messages = Family("counter", "mqtt_messages", "Messages to the MQTT broker by what became of them.", ("result",))
    messages.add(mqtt.messages, "ok")
    messages.add(mqtt.refused_messages, "refused")
    commands = Family("counter", "mqtt_commands", "Values for points that the MQTT broker has delivered.", ("result",))
    commands.add(mqtt.commands - mqtt.refused_commands, "ok")
    commands.add(mqtt.refused_commands, "refused")
    polls = Family("counter", "mqtt_polls", "Reads of published points.", ("result",))
    polls.add(mqtt.polls - mqtt.failed_polls, "ok")
    polls.add(mqtt.failed_polls, "failed")
    devices = Family("gauge", "mqtt_devices", "Published devices by whether they answer.", ("state",))
    devices.add(mqtt.available, "online")
    devices.add(mqtt.devices - mqtt.available, "offline")
    yield from (up, messages, commands, polls, devices)
