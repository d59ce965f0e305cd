"""What a config publishes, as `check` shows it: each device with its topic."""

from collections.abc import Iterator
from typing import Any, Final

from gateway.cli.kit.columns import align, without_middles
from gateway.config.plan.add_ons import longest_outage
from gateway.config.plan.settings import MqttPlan, Plan
from gateway.config.problem import listed
from gateway.config.values.duration import show_size
from gateway.plant.topics import SparkplugTopics, Topics
from gateway.profiles.published import PublishedDevice

_UNITS: Final = (("days", 86400), ("h", 3600), ("min", 60), ("s", 1))


def published_as_text(plan: Plan) -> list[str]:
    """Show a table of the devices, if any are published."""
    mqtt = plan.mqtt
    if mqtt is None:
        return []
    rows = [
        (
            device.name,
            _topic(mqtt, device),
            listed(_read(device)) or "none",
            listed(_left_out(plan, device)) or "none",
            listed(_set(device)) or "none",
        )
        for device in mqtt.devices
    ]
    head = ("DEVICE", "TOPIC", "POINTS", "LEFT OUT", "SET THROUGH THE BROKER")
    table = align([head, *without_middles(rows, (0, 1))], "  ")
    return ["\n".join([f"Broker {mqtt.broker}", *_form(mqtt), *_kept(mqtt), table, *_heard(mqtt)])]


def published_as_json(plan: Plan) -> dict[str, Any] | None:
    """Make the broker and the devices for programs; None if nothing is published."""
    mqtt = plan.mqtt
    if mqtt is None:
        return None
    return {
        "broker": str(mqtt.broker),
        "form": "json" if mqtt.sparkplug is None else "sparkplug",
        "home_assistant": mqtt.home_assistant,
        "keep": _kept_as_json(mqtt),
        "devices_left_out": list(mqtt.heard),
        "devices": [
            {
                "device": device.name,
                "topic": _topic(mqtt, device),
                "points": _read(device),
                "left_out": _left_out(plan, device),
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
    yield f"  JSON; {Topics(mqtt.site, mqtt.prefix).status} says whether the gateway is there"
    if mqtt.home_assistant is not None:
        yield f"  Announced to Home Assistant below {mqtt.home_assistant}/"


def _heard(mqtt: MqttPlan) -> Iterator[str]:
    if mqtt.heard:
        yield f"  Left out, because only others ask them: {listed(mqtt.heard)}; a mirror can be published."


def _kept(mqtt: MqttPlan) -> Iterator[str]:
    outage = longest_outage(mqtt)
    if outage is not None:
        rate = f"{round(outage.values_per_s, 3):g} values/s"
        yield f"  Kept while the broker is away: {show_size(mqtt.keep)}, at least {_time(outage.seconds)} at {rate}"


def _kept_as_json(mqtt: MqttPlan) -> dict[str, float] | None:
    outage = longest_outage(mqtt)
    if outage is None:
        return None
    return {"bytes": mqtt.keep, "at_least_s": int(outage.seconds), "values_per_s": round(outage.values_per_s, 3)}


def _time(seconds: float) -> str:
    """Show a time in its greatest unit of which there are two, rounded down."""
    unit, length = next((one for one in _UNITS if seconds >= 2 * one[1]), _UNITS[-1])
    return f"{int(seconds / length)} {unit}"


def _topic(mqtt: MqttPlan, device: PublishedDevice) -> str:
    names = mqtt.sparkplug
    if names is None:
        return Topics(mqtt.site, mqtt.prefix).values(device.name)
    return SparkplugTopics(names.group, names.node or mqtt.site).of("DDATA", device.name)


def _read(device: PublishedDevice) -> list[str]:
    return [point.name for point in device.points if point.is_readable]


def _left_out(plan: Plan, device: PublishedDevice) -> list[str]:
    """List the points of a device that could be read, and are not published."""
    points = plan.points.get(device.unit, ())
    return [point.name for point in points if point.write != "only" and device.point(point.name) is None]


def _set(device: PublishedDevice) -> list[str]:
    return [point.name for point in device.points if point.is_writable]
