"""What is published beside values: devices that are gone."""

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.service.announced import AnnouncedDevices
from gateway.service.publication import _Announcing


def announcing(announced, *devices, more=""):
    images = "".join(
        f'[[image]]\nunit = {unit}\nname = "{name}"\nholding = 4\nprofile = "a"\n'
        for unit, name in enumerate(devices, 1)
    )
    mqtt = f'[mqtt]\nbroker = "mqtt://broker"\npublish = [{{ device = "*", every = "1 s" }}]\n{more}\n'
    profile = '[profile.a]\npoints = [{ name = "a", holding = 0 }]\n'
    loaded = parse(f'site = "p"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n{images}{mqtt}{profile}', "g.toml")
    assert loaded.config is not None, loaded.problems
    return _Announcing(resolve(loaded.config).mqtt, announced)


def told(announced, *devices, more=""):
    return [(each.topic, each.payload, each.retain) for each in announcing(announced, *devices, more=more).messages]


GONE = [("modbus/p/im2/availability", b"offline", True), ("modbus/p/im2", b"", True)]


def test_a_device_that_is_gone_is_offline_and_has_no_values_any_more():
    announced = AnnouncedDevices()
    announcing(announced, "im1", "im2").done()
    assert told(announced, "im1") == GONE
    assert told(announced, "im1") == GONE, "until the broker has it"
    announcing(announced, "im1").done()
    assert told(announced, "im1") == []


def test_under_sparkplug_it_remains_known_what_is_to_be_taken_back():
    announced = AnnouncedDevices()
    announcing(announced, "im1", "im2").done()
    sparkplug = announcing(announced, "im1", more='sparkplug = { group = "a" }')
    assert sparkplug.messages == ()
    sparkplug.done()
    assert told(announced, "im1") == GONE
