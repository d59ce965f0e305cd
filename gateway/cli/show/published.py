"""What a config publishes, as `check` shows it: each device with its topic."""

from collections.abc import Iterator
from typing import Any

from gateway.cli.kit.columns import align, without_middles
from gateway.config.plan.settings import MqttPlan, Plan
from gateway.plant.topics import SparkplugTopics, Topics
from gateway.profiles.published import PublishedDevice


def published_as_text(plan: Plan) -> list[str]:
    """Show a table of the devices, if any are published."""
    mqtt = plan.mqtt
    if mqtt is None:
        return []
    rows = [(device.name, _topic(mqtt, device), _names(_read(device)), _names(_set(device))) for device in mqtt.devices]
    table = align([("DEVICE", "TOPIC", "POINTS", "SET THROUGH THE BROKER"), *without_middles(rows, (0, 1))], "  ")
    return ["\n".join([f"Broker {mqtt.broker}", *_form(mqtt), table])]


def published_as_json(plan: Plan) -> dict[str, Any] | None:
    """Make the broker and the devices for programs; None if nothing is published."""
    mqtt = plan.mqtt
    if mqtt is None:
        return None
    return {
        "broker": str(mqtt.broker),
        "form": "json" if mqtt.sparkplug is None else "sparkplug",
        "home_assistant": mqtt.home_assistant,
        "devices": [
            {
                "device": device.name,
                "topic": _topic(mqtt, device),
                "points": _read(device),
                "settable": _set(device),
            }
            for device in mqtt.devices
        ],
    }


def _form(mqtt: MqttPlan) -> Iterator[str]:
    if mqtt.sparkplug is not None:
        host = mqtt.sparkplug.primary_host
        yield "  Sparkplug B" + (f", while the host {host} is there" if host else "")
        return
    yield f"  JSON; {Topics(mqtt.site).status} says whether the gateway is there"
    if mqtt.home_assistant is not None:
        yield f"  Announced to Home Assistant below {mqtt.home_assistant}/"


def _topic(mqtt: MqttPlan, device: PublishedDevice) -> str:
    names = mqtt.sparkplug
    if names is None:
        return Topics(mqtt.site).values(device.name)
    return SparkplugTopics(names.group, names.node or mqtt.site).of("DDATA", device.name)


def _read(device: PublishedDevice) -> list[str]:
    return [point.name for point in device.points if point.is_readable]


def _set(device: PublishedDevice) -> list[str]:
    return [point.name for point in device.points if point.is_writable]


def _names(names: list[str]) -> str:
    """Show as many names as fit into a line of a terminal."""
    if not names:
        return "none"
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"
