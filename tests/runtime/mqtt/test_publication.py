"""What is published beside values: what announces devices, and takes back those that are gone."""

import json

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.runtime.mqtt.announced import AnnouncedDevices
from gateway.runtime.mqtt.announcing import Announcing


async def announcing(announced, *devices, more="", site="p"):
    images = "".join(
        f'[[image]]\nunit = {unit}\nname = "{name}"\nholding = 4\nprofile = "a"\n'
        for unit, name in enumerate(devices, 1)
    )
    mqtt = f'[mqtt]\nbroker = "mqtt://broker"\npublish = [{{ device = "*", every = "1 s" }}]\n{more}\n'
    profile = '[profile.a]\npoints = [{ name = "a", holding = 0 }]\n'
    loaded = parse(f'site = "{site}"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n{images}{mqtt}{profile}', "g.toml")
    assert loaded.config is not None, loaded.problems
    return await Announcing.of(resolve(loaded.config).mqtt, announced)


async def told(announced, *devices, **more):
    return shown((await announcing(announced, *devices, **more)).messages)


def shown(messages):
    return [(each.topic, each.payload, each.retain) for each in messages]


GONE = [("modbus/p/im2/availability", b"offline", True), ("modbus/p/im2", b"", True)]
OTHER_GONE = [("modbus/p/im1/availability", b"offline", True), ("modbus/p/im1", b"", True)]
HOME = "home_assistant = true"


async def test_a_device_that_is_gone_is_offline_and_has_no_values_any_more():
    announced = AnnouncedDevices()
    (await announcing(announced, "im1", "im2")).done()
    assert await told(announced, "im1") == GONE
    assert await told(announced, "im1") == GONE, "until the broker has it"
    (await announcing(announced, "im1")).done()
    assert await told(announced, "im1") == []


async def test_home_assistant_forgets_a_device_that_is_gone():
    announced = AnnouncedDevices()
    (await announcing(announced, "im1", "im2", more=HOME)).done()
    assert {*GONE, ("homeassistant/device/p/im2/config", b"", True)} < set(await told(announced, "im1", more=HOME))


@pytest.mark.parametrize("more", [{"more": 'sparkplug = { group = "a" }'}, {"site": "q"}])
async def test_another_form_or_site_takes_back_what_was_announced_before(more):
    announced = AnnouncedDevices()
    (await announcing(announced, "im1", more=HOME)).done()
    assert await told(announced, "im1", **more) == [
        ("homeassistant/device/p/im1/config", b"", True),
        *OTHER_GONE,
    ]
    (await announcing(announced, "im1", **more)).done()
    assert await told(announced, "im1", **more) == []


async def test_another_prefix_takes_back_what_was_published_below_the_one_before():
    announced = AnnouncedDevices()
    (await announcing(announced, "im1", more=HOME)).done()
    announcements = await told(announced, "im1", more=f'{HOME}\nprefix = "works/a"')
    assert announcements[:2] == OTHER_GONE
    topic, description, _ = announcements[2]
    assert topic == "homeassistant/device/p/im1/config"
    assert json.loads(description)["stat_t"] == "works/a/p/im1"
    (await announcing(announced, "im1", more='prefix = "works/a"')).done()
    back = await told(announced, "im1")
    assert back == [("works/a/p/im1/availability", b"offline", True), ("works/a/p/im1", b"", True)]


async def test_what_is_withdrawn_for_good_is_forgotten():
    announced = AnnouncedDevices()
    announcing_ = await announcing(announced, "im1", more=HOME)
    assert shown(announcing_.withdrawal()) == [("homeassistant/device/p/im1/config", b"", True), *OTHER_GONE]
    announcing_.withdrawn()
    assert announced.entries() == {}
