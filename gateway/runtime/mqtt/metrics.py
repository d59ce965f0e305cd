"""Metrics of what is published."""

from collections.abc import Iterator

from gateway.observe.families import Family
from gateway.plant.status import BrokerStatus, KeptStatus


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
    if mqtt.kept is not None:
        yield from _metrics_of_kept(mqtt.kept)


def _metrics_of_kept(kept: KeptStatus) -> Iterator[Family]:
    """Tell what waits to be sent."""
    values = Family("gauge", "mqtt_kept_values", "Values that are kept until they can be sent to the MQTT broker.")
    values.add(kept.values)
    used = Family("gauge", "mqtt_kept_bytes", "What kept values take of the disk; full at 7/8 of the limit.")
    used.add(kept.bytes)
    limit = Family("gauge", "mqtt_kept_limit_bytes", "What kept values and their journal may take of the disk.")
    limit.add(kept.limit)
    since = Family("gauge", "mqtt_kept_since_seconds", "The age of the oldest kept value; absent if there is none.")
    if kept.age_ms is not None:
        since.add(kept.age_ms / 1000)
    given_up = Family("counter", "mqtt_given_up_values", "Kept values that will never be sent.")
    given_up.add(kept.given_up)
    yield from (values, used, limit, since, given_up)
