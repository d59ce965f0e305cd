import pytest

from gateway.config.load import parse
from gateway.config.plan.line_load import load_of
from gateway.config.resolve import resolve

DEVICES = """\
site = "plant-2"

[[line]]
port = "/dev/a"
devices = [
  { unit = 1, as = 41, name = "silo-1", profile = "scale" },
  { unit = 2, as = 42, name = "silo-2", profile = "scale" },
  { unit = 3, as = 43, name = "hall/3", profile = "scale" },
  { unit = 4, as = 44, name = "mute" },
]

[profile.scale]
title  = "A scale"
limits = { 3 = 10 }
points = [
  { name = "weight", holding = 0, type = "float32", unit = "kg" },
  { name = "state", holding = 2, write = true },
  { name = "order", holding = 3, write = "only" },
  { name = "level", holding = 20 },
]
"""
BROKER = 'broker = "mqtt://broker"\n'
ROW = 'publish = [{ device = "silo-1", every = "1 s" }]\n'
NOT_DONE = (("publish", "read"), ("write", "written"))
OWN_STATUS = "modbus/plant-2/status says whether the gateway is there"


def problems(text):
    found = parse(text, "g.toml", port_trouble=lambda _: None, real_path=str).problems
    return [f"{each.severity}: {each.subject}{each.what}" for each in found]


def of_mqtt(keys, devices=DEVICES):
    return problems(f"{devices}\n[mqtt]\n{keys}")


def plan_of(keys):
    loaded = parse(f"{DEVICES}\n[mqtt]\n{BROKER}{keys}", "g.toml")
    assert loaded.config is not None, loaded.problems
    return resolve(loaded.config)


def published(keys):
    return {device.name: [point.name for point in device.points] for device in plan_of(keys).mqtt.devices}


def test_what_is_needed_is_enough():
    assert of_mqtt(BROKER + ROW) == []


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('broker = "mqtt://0.0.0.0"\n' + ROW, "mqtt.broker: 0.0.0.0 is not the address of a broker"),
        ('broker = "mqtt://broker:0"\n' + ROW, "mqtt.broker: port 0 is not the port of a broker"),
        ('broker = "mqtt://broker/path"\n' + ROW, "mqtt.broker: mqtt:// has no path"),
        (
            'broker = "mqtt://me:secret@broker"\n' + ROW,
            "mqtt.broker: contains a user, which everybody who sees the config can see",
        ),
        ('broker = "tcp://broker"\n' + ROW, "mqtt.broker: unknown protocol tcp://"),
        (BROKER + ROW + 'ca = "/ca.crt"', "mqtt.ca: is used only with mqtts:// and wss://"),
        (
            'broker = "mqtts://broker"\n' + ROW + 'certificate = "/a.crt"',
            "mqtt.certificate: has no effect without key",
        ),
        (BROKER + ROW + 'password = { file = "/p" }', "mqtt.password: has no effect without user"),
        (BROKER + ROW + 'user = "me"\npassword = "secret"', "mqtt.password: names no file"),
        (BROKER + "publish = []", "mqtt.publish: is empty"),
        (BROKER, "mqtt.publish: publish is missing"),
        (
            BROKER + 'publish = [{ device = "silo-3", every = "1 s" }]',
            'mqtt.publish[0].device: nothing is called "silo-3"',
        ),
        (BROKER + 'publish = [{ device = "mute", every = "1 s" }]', "mqtt.publish[0].device: mute has no points"),
        (
            BROKER + 'publish = [{ device = "silo-*", points = ["state", "wight"], every = "1 s" }]',
            'mqtt.publish[0].points[1]: silo-1, silo-2 has no point "wight"',
        ),
        (
            BROKER + 'publish = [{ device = "hall/3", every = "1 s" }]',
            "mqtt.publish: hall/3 cannot be a part of topics, where +, # and / mean something else",
        ),
        (
            BROKER + 'write = true\npublish = [{ device = "silo-1", points = ["weight"], every = "1 s" }]',
            "mqtt.write: none of these points can be written",
        ),
        (
            BROKER + ROW + 'home_assistant = true\nsparkplug = { group = "a" }',
            "mqtt.home_assistant: Home Assistant does not understand Sparkplug B",
        ),
        (BROKER + ROW + 'keep_every = "1 min"', "mqtt.keep_every: has no effect without keep"),
        (BROKER + ROW + 'keep = "0"\nkeep_every = "1 min"', "mqtt.keep_every: has no effect without keep"),
        (BROKER + ROW + 'keep = "63 KiB"', "mqtt.keep: must be 64 KiB to 1 GiB, or 0 for none"),
        (BROKER + ROW + 'keep = "1 MiB"\nkeep_every = "0.9 s"', "mqtt.keep_every: must be at least 1 s"),
        (BROKER + ROW + 'keep = "1 MiB"\nkeep_every = "11 min"', "mqtt.keep_every: must be at most 10 min"),
        (BROKER + ROW + 'sparkplug = { group = "a/b" }', "mqtt.sparkplug: group must be text without +, # and /"),
        (BROKER + ROW + "sparkplug = { }", "mqtt.sparkplug: must be false or a table with a group"),
        (
            BROKER + ROW + 'home_assistant = "#"',
            'mqtt.home_assistant: "#" cannot be the beginning of topics',
        ),
        (
            BROKER + ROW + "home_assistant = 1",
            'mqtt.home_assistant: must be true, false or a prefix of topics such as "homeassistant"',
        ),
        *(
            (BROKER + ROW + f'prefix = "{prefix}"', f'mqtt.prefix: "{prefix}" cannot be the beginning of topics')
            for prefix in ("", "/", "/a", "a/", "a//b", "a/+", "a#", "$SYS/a")
        ),
        (BROKER + ROW + "prefix = 1", "mqtt.prefix: must be text"),
        (BROKER + ROW + f'prefix = "{"a" * 257}"', "mqtt.prefix: must have at most 256 characters"),
        (BROKER + ROW + 'prefix = "spBv1.0/a"', "mqtt.prefix: topics below spBv1.0 are those of Sparkplug B"),
        (
            BROKER + ROW + 'prefix = "modbus"\nsparkplug = { group = "a" }',
            "mqtt.prefix: has no effect with sparkplug, whose topics begin with spBv1.0",
        ),
        *(
            (
                BROKER + ROW + f'prefix = "{prefix}"\nhome_assistant = true',
                "mqtt.prefix: below homeassistant Home Assistant is told what there is, so values need other topics",
            )
            for prefix in ("homeassistant", "homeassistant/values")
        ),
        (
            BROKER + ROW + 'home_assistant = "modbus"',
            "mqtt.home_assistant: below modbus Home Assistant is told what there is, so values need other topics",
        ),
        (
            BROKER + ROW + 'home_assistant = "modbus/plant-2"',
            f"mqtt.home_assistant: {OWN_STATUS}, not whether Home Assistant is",
        ),
        (
            BROKER + 'publish = [{ device = "silo-*", points = ["*", "!wight*"], every = "1 s" }]',
            'mqtt.publish[0].points[1]: silo-1, silo-2 has no point "wight*"',
        ),
        *(
            (
                BROKER + f'publish = [{{ device = "silo-1", points = [{points}], every = "1 s" }}]',
                "mqtt.publish[0].points: leaves no point to publish",
            )
            for points in ("", '"weight", "!weight"', '"!*"')
        ),
    ],
)
def test_what_does_not_fit_together_is_told_with_its_key(keys, said):
    assert of_mqtt(keys) == [f"error: {said}"]


@pytest.mark.parametrize("keys", ['prefix = "homeassistants"\nhome_assistant = true', 'home_assistant = "modbus/ha"'])
def test_a_prefix_beside_that_of_home_assistant_is_one(keys):
    assert of_mqtt(BROKER + ROW + keys) == []


@pytest.mark.parametrize("prefix", ["factory", "factory/hall 3/line-a", "v1.0/$x", "w" * 256])
def test_a_prefix_may_have_several_levels(prefix):
    assert plan_of(ROW + f'prefix = "{prefix}"').mqtt.prefix == prefix
    assert plan_of(ROW).mqtt.prefix == "modbus"


def test_what_is_kept_is_in_the_plan():
    plan = plan_of(ROW + 'keep = "64 MiB"\nkeep_every = "30 s"').mqtt
    assert (plan.keep, plan.keep_every) == (64 * 2**20, 30)
    usual = plan_of(ROW).mqtt
    assert (usual.keep, usual.keep_every) == (0, 10)


def test_topics_need_the_name_of_the_plant():
    said = "error: mqtt.broker: needs the name of the plant, which is a part of all topics"
    assert of_mqtt(BROKER + ROW, DEVICES.partition("\n")[2]) == [said]


def test_what_is_published_must_be_readable_for_the_client_mqtt():
    row = '[[access]]\nlisten = ["mqtt"]\nunits = 42\nallow = ["read"]\n'
    assert of_mqtt(BROKER + ROW + row) == ["error: mqtt.publish: silo-1 may not be read"]
    assert of_mqtt(BROKER + ROW.replace("silo-1", "silo-2") + row) == []


def test_what_is_to_be_written_must_be_writable_for_the_client_mqtt():
    row = '[[access]]\nlisten = ["mqtt"]\nallow = ["read"]\n'
    assert of_mqtt(BROKER + ROW + "write = true\n" + row) == ["error: mqtt.write: silo-1 may not be written"]
    assert of_mqtt(BROKER + ROW + row) == []
    assert of_mqtt(BROKER + ROW + 'write = true\n[[access]]\nunits = 42\nallow = ["read"]\n') == []


def test_the_first_row_counts_that_matches_device_and_point():
    plan = plan_of(
        'publish = [{ device = "silo-1", points = ["w*"], every = "1 s", on_change = 0.5, at_least = "1 min" },'
        ' { device = "silo-?", every = "5 s" }]'
    )
    first, second = plan.mqtt.devices
    assert [(point.name, point.every) for point in first.points] == [("weight", 1.0), ("state", 5.0), ("level", 5.0)]
    assert (first.points[0].on_change, first.points[0].at_least) == (0.5, 60.0)
    assert [(point.name, point.every) for point in second.points] == [("weight", 5.0), ("state", 5.0), ("level", 5.0)]
    assert (first.name, first.unit, first.profile) == ("silo-1", 41, "A scale")


@pytest.mark.parametrize(
    ("points", "named"),
    [
        (["*", "!w*"], ["state", "level"]),
        (["!w*"], ["state", "level"]),
        (["!weight", "!level"], ["state"]),
        (["!weight", "weight", "level"], ["level"]),
        (["level", "!weight"], ["level"]),
        (["l*", "w*", "!*t"], ["level"]),
    ],
)
def test_points_behind_an_exclamation_mark_are_left_out(points, named):
    assert published(f'publish = [{{ device = "silo-1", points = {points}, every = "1 s" }}]') == {"silo-1": named}


def test_what_a_row_leaves_out_a_later_one_may_take():
    (device,) = plan_of(
        'publish = [{ device = "silo-1", points = ["!level"], every = "1 s" }, { device = "silo-1", every = "5 s" }]'
    ).mqtt.devices
    assert [(point.name, point.every) for point in device.points] == [("weight", 1.0), ("state", 1.0), ("level", 5.0)]


def test_what_is_only_written_is_there_if_writing_is():
    row = 'publish = [{ device = "silo-1", points = ["order", "state"], every = "1 s" }]\n'
    assert published(row) == {"silo-1": ["state"]}
    assert published(row + "write = true") == {"silo-1": ["state", "order"]}


def test_the_reads_count_in_the_forecast_as_they_are_sent():
    plan = plan_of(
        'publish = [{ device = "silo-1", every = "1 s" }, { device = "silo-2", points = ["level"], every = "2 s" }]'
    )
    polls = [one.declared for one in load_of(plan.lines[0], plan)]
    assert [(one.by, one.of.name, str(one.poll), one.poll.every) for one in polls] == [
        (("mqtt",), "silo-1", "holding 0-2", 1.0),
        (("mqtt",), "silo-1", "holding 20", 1.0),
        (("mqtt",), "silo-2", "holding 20", 2.0),
    ]


def test_polls_for_mqtt_that_take_all_of_a_line_are_told():
    said = of_mqtt(BROKER + 'publish = [{ device = "silo-*", every = "10 ms" }]')
    assert [each.partition("need ")[0] for each in said] == ["warning: line[0]: the polls of MQTT "]


def test_images_and_mirrors_are_published_too():
    more = '[[image]]\nunit = 9\nname = "shift"\nprofile = "scale"\nholding = 4\n'
    loaded = parse(f'{DEVICES}\n{more}[mqtt]\n{BROKER}publish = [{{ device = "shift", every = "1 s" }}]', "g.toml")
    [device] = resolve(loaded.config).mqtt.devices
    assert (device.unit, [point.name for point in device.points]) == (9, ["weight", "state"])


def test_names_that_plain_messages_use_for_something_else_are_refused():
    devices = DEVICES.replace("hall/3", "status").replace('"level"', '"time"')
    row = 'publish = [{ device = "status", points = ["POINT"], every = "1 s" }]\n'
    status = "error: mqtt.publish: the topic of status says whether the gateway is there"
    time = 'error: mqtt.publish: the point "time" of status has the name of the time of each message'
    assert of_mqtt(BROKER + row.replace("POINT", "weight"), devices) == [status]
    assert of_mqtt(BROKER + row.replace("POINT", "time"), devices) == [status, time]
    assert of_mqtt(BROKER + row.replace("POINT", "time") + 'sparkplug = { group = "a" }', devices) == []


def test_with_keep_a_point_must_not_have_the_name_of_what_is_told_of_the_clock():
    devices = DEVICES.replace('"level"', '"clock"')
    said = 'error: mqtt.publish: the point "clock" of silo-1 has the name of what kept values tell of the clock'
    assert of_mqtt(BROKER + ROW, devices) == []
    assert of_mqtt(BROKER + ROW + 'keep = "1 MiB"', devices) == [said]
    assert of_mqtt(BROKER + ROW + 'keep = "1 MiB"\nsparkplug = { group = "a" }', devices) == []


def test_a_site_is_printable():
    devices = DEVICES.replace("plant-2", "plant\\u00012")
    assert of_mqtt(BROKER + ROW, devices) == ["error: site: is a part of topics, where +, # and / mean something else"]


def test_under_sparkplug_names_that_differ_by_case_only_are_told():
    devices = DEVICES.replace("hall/3", "Silo-1").replace('"level"', '"Weight"')
    row = 'publish = [{ device = "?ilo-1", every = "1 s" }]\n'
    assert of_mqtt(BROKER + row, devices) == []
    alike = "differ by upper and lower case only: Sparkplug hosts may take them for one"
    assert of_mqtt(BROKER + row + 'sparkplug = { group = "a" }\n', devices) == [
        f"warning: mqtt.publish: the devices silo-1, Silo-1 {alike}",
        f"warning: mqtt.publish: the points of silo-1 weight, Weight {alike}",
        f"warning: mqtt.publish: the points of Silo-1 weight, Weight {alike}",
    ]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (
            'holding = "0-99"\nallow = []',
            ["mqtt.publish: silo-1 may not be read", "mqtt.write: silo-1 may not be written"],
        ),
        ('holding = "0-99"\nallow = ["read"]', ["mqtt.write: silo-1 may not be written"]),
        ('holding = "0-99"\nallow = ["read", "write"]', []),
        ('holding = "1000-1099"\nallow = []', []),
        ('coils = "0-99"\nallow = []', []),
    ],
)
def test_rows_for_addresses_count_where_points_are(rows, said):
    text = "".join(f'[[access]]\nlisten = ["mqtt"]\n{row}\n' for row in (rows, 'allow = ["read", "write"]'))
    assert of_mqtt(BROKER + ROW + "write = true\n" + text) == [f"error: {each}" for each in said]
