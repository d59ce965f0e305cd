"""Cross-checks of `[mqtt]`: what it needs, and that its rows mean something that it may read and write."""

import fnmatch
from collections.abc import Iterator, Mapping
from typing import Final

from gateway.config.plan.add_ons import EXCLUDES, Publishable, names_device, names_point, publishable
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, did_you_mean, error, listed, warning
from gateway.config.schema.add_ons import Mqtt, Publish
from gateway.config.schema.config import Config
from gateway.config.values.broker import SPARKPLUG, is_topic_part
from gateway.config.values.reserved_names import MQTT
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.profiles.writing import writes_of
from gateway.registers.items import read_request
from gateway.routing.access import EntryPoint
from gateway.routing.rights import Rights

_TLS_KEYS: Final = ("ca", "certificate", "key", "server_name")
#: Names in plain messages: the topic beside those of devices, and the key beside those of points.
_STATUS: Final = "status"
_TIME: Final = "time"
#: A key beside points in values that were kept.
_CLOCK: Final = "clock"


def check_mqtt(config: Config, _failed: frozenset[str]) -> Iterator[Problem]:
    """Find keys of `[mqtt]` that do not fit together."""
    mqtt = config.mqtt
    if mqtt is None:
        return
    yield from _check_site(config.site, mqtt)
    yield from _check_broker(mqtt)
    yield from _check_needed(mqtt)
    if not mqtt.publish:
        remedy = 'write publish = [{ device = "silo-*", every = "1 s" }]'
        yield error((*mqtt.path, "publish"), "is empty", remedy)
    yield from _check_prefix(config.site, mqtt)


def check_published(config: Config, plan: Plan) -> Iterator[Problem]:
    """Find rows of `publish` that mean no point, or one that may not be read or written."""
    mqtt = config.mqtt
    if mqtt is None:
        return
    for row in mqtt.publish:
        yield from _check_row(row, tuple(publishable(plan)), plan.heard_on)
    devices = () if plan.mqtt is None else plan.mqtt.devices
    yield from _check_topics(mqtt, devices)
    yield from _check_rights(mqtt, devices, plan)
    if mqtt.write and not any(point.is_writable for device in devices for point in device.points):
        what = "none of these points can be written"
        yield error((*mqtt.path, "write"), what, "add write = true to a point, or leave it out here")


def _check_site(site: str, mqtt: Mqtt) -> Iterator[Problem]:
    if not site:
        what = "needs the name of the plant, which is a part of all topics"
        yield error((*mqtt.path, "broker"), what, 'add site = "plant-2" at the top of the file')
    elif not is_topic_part(site):
        yield error(("site",), "is a part of topics, where +, # and / mean something else", "choose another name")


def _check_prefix(site: str, mqtt: Mqtt) -> Iterator[Problem]:
    """Find a prefix of topics that nothing uses, or that others use."""
    announced = mqtt.home_assistant
    if mqtt.sparkplug is not None:
        if announced is not None:
            what = "Home Assistant does not understand Sparkplug B"
            yield error((*mqtt.path, "home_assistant"), what, "leave one of the two out")
        if mqtt.has("prefix"):
            what = f"has no effect with sparkplug, whose topics begin with {SPARKPLUG}"
            yield error((*mqtt.path, "prefix"), what, "leave one of the two out")
    elif announced is not None and f"{mqtt.prefix}/".startswith(f"{announced}/"):
        what = f"below {announced} Home Assistant is told what there is, so values need other topics"
        yield error((*mqtt.path, "prefix" if mqtt.has("prefix") else "home_assistant"), what, "choose another prefix")
    elif announced == f"{mqtt.prefix}/{site}":
        what = f"{announced}/{_STATUS} says whether the gateway is there, not whether Home Assistant is"
        yield error((*mqtt.path, "home_assistant"), what, "choose another prefix")


def _check_broker(mqtt: Mqtt) -> Iterator[Problem]:
    address, path = mqtt.broker.address, (*mqtt.path, "broker")
    if address.is_wildcard:
        yield error(path, f"{address.host} is not the address of a broker", "write its host name or address")
    if not address.port:
        yield error(path, "port 0 is not the port of a broker")
    for key in () if mqtt.broker.is_encrypted else filter(mqtt.has, _TLS_KEYS):
        yield error((*mqtt.path, key), "is used only with mqtts:// and wss://", "write mqtts:// in broker")


def _check_needed(mqtt: Mqtt) -> Iterator[Problem]:
    for one, other in (("certificate", "key"), ("key", "certificate")):
        if mqtt.has(one) and not mqtt.has(other):
            yield error((*mqtt.path, one), f"has no effect without {other}", f"add {other}")
    if mqtt.password is not None and mqtt.user is None:
        yield error((*mqtt.path, "password"), "has no effect without user", "add user")
    if mqtt.has("keep_every") and not mqtt.keep:
        yield error((*mqtt.path, "keep_every"), "has no effect without keep", 'add keep = "64 MiB"')


def _check_row(row: Publish, known: tuple[Publishable, ...], heard_on: Mapping[str, str]) -> Iterator[Problem]:
    """Find rows that match no device, and patterns that match no point. `heard_on` is that of the plan."""
    meant = [each for each in known if names_device(row, each.name)]
    heard = next((name for name in heard_on if names_device(row, name)), None)
    if not meant and heard is not None:
        what = f'line "{heard_on[heard]}" only listens, so nobody polls {heard}'
        remedy = f'publish a mirror of it: [[image]] with of = "{heard}", and its name here'
        yield error((*row.path, "device"), what, remedy)
        return
    if not meant:
        remedy = did_you_mean(row.device, (each.name for each in known))
        yield error((*row.path, "device"), f'nothing is called "{row.device}"', remedy)
        return
    points = [point for each in meant for point in each.points]
    if not points:
        what = "has no points" if len(meant) == 1 else "are devices without points"
        remedy = "give points to its profile, or to the device itself"
        yield error((*row.path, "device"), f"{listed([each.name for each in meant])} {what}", remedy)
        return
    names = [point.name for point in points]
    missing = [each for each in enumerate(row.points) if not fnmatch.filter(names, each[1].removeprefix(EXCLUDES))]
    for index, pattern in missing:
        name = pattern.removeprefix(EXCLUDES)
        what = f'{listed([each.name for each in meant])} has no point "{name}"'
        yield error((*row.path, "points", index), what, did_you_mean(name, names))
    if not missing and not any(names_point(row, name) for name in names):
        yield error((*row.path, "points"), "leaves no point to publish", "leave the row out, or fewer of its points")


def _check_topics(mqtt: Mqtt, devices: tuple[PublishedDevice, ...]) -> Iterator[Problem]:
    """Find devices whose names cannot be parts of topics, or mean something else there. Names of points always can."""
    wrong = [device.name for device in devices if not is_topic_part(device.name)]
    if wrong:
        what = f"{listed(wrong)} cannot be a part of topics, where +, # and / mean something else"
        yield error((*mqtt.path, "publish"), what, "give the device another name: name = ...")
    if mqtt.sparkplug is None:
        yield from _check_taken(mqtt, devices)
        return
    yield from _check_alike(mqtt, [device.name for device in devices], "devices")
    for device in devices:
        yield from _check_alike(mqtt, [point.name for point in device.points], f"points of {device.name}")


def _check_alike(mqtt: Mqtt, names: list[str], what: str) -> Iterator[Problem]:
    """Find names that differ by case only, which Sparkplug hosts may take for one."""
    alike: dict[str, list[str]] = {}
    for name in names:
        alike.setdefault(name.casefold(), []).append(name)
    for same in alike.values():
        if len(same) > 1:
            problem = (
                f"the {what} {listed(same)} differ by upper and lower case only: Sparkplug hosts may take them for one"
            )
            yield warning((*mqtt.path, "publish"), problem, "give them other names")


def _check_taken(mqtt: Mqtt, devices: tuple[PublishedDevice, ...]) -> Iterator[Problem]:
    """Find devices and points with a name that plain messages use for something else."""
    taken = {_TIME: "the time of each message"}
    if mqtt.keep:
        taken[_CLOCK] = "what kept values tell of the clock"
    for device in devices:
        if device.name == _STATUS:
            what = f"the topic of {_STATUS} says whether the gateway is there"
            yield error((*mqtt.path, "publish"), what, "give the device another name: name = ...")
        for name, meaning in taken.items():
            if device.point(name):
                what = f'the point "{name}" of {device.name} has the name of {meaning}'
                remedy = "give the point another name, or leave it out of points here"
                yield error((*mqtt.path, "publish"), what, remedy)


def _check_rights(mqtt: Mqtt, devices: tuple[PublishedDevice, ...], plan: Plan) -> Iterator[Problem]:
    """Find points that rows of `[[access]]` keep the broker from reading or writing."""
    rights = Rights(plan.access, EntryPoint(MQTT, "local"))
    unread = [device.name for device in devices if not all(_may_read(rights, device, one) for one in device.points)]
    remedy = f'a row of [[access]] names "{MQTT}", so another must allow it'
    if unread:
        what = f"{listed(unread)} may not be read"
        yield error((*mqtt.path, "publish"), what, f'{remedy}: listen = ["{MQTT}"], allow = ["read"]')
    shut = [device.name for device in devices if any(_is_shut(rights, device, one) for one in device.points)]
    if shut:
        what = f"{listed(shut)} may not be written"
        yield error((*mqtt.path, "write"), what, f'{remedy}: listen = ["{MQTT}"], allow = ["read", "write"]')


def _may_read(rights: Rights, device: PublishedDevice, point: PublishedPoint) -> bool:
    return not point.is_readable or rights.permits("", device.unit, read_request(point.point.read_span))


def _is_shut(rights: Rights, device: PublishedDevice, point: PublishedPoint) -> bool:
    """Tell whether a point is to be written, and no request that writes it is allowed."""
    return point.is_writable and not any(rights.permits("", device.unit, pdu) for pdu in writes_of(point.point))
