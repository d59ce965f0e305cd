"""What Home Assistant is told of devices. Its own schemas and tables stand in homeassistant.json, with their source."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from jinja2 import Environment

from gateway.modbus.codes import Area
from gateway.plant.discovery import Discovery
from gateway.plant.topics import Topics
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint

THEIRS = json.loads((Path(__file__).parent / "homeassistant.json").read_text(encoding="utf-8"))
DISCOVERY = Discovery(Topics("plant-2"), "homeassistant")

WEIGHT = Point("weight", Area.HOLDING, 0, "float32", count=2, decimals=2, unit="kg")
STATE = Point("state", Area.HOLDING, 8, labels={0: "off", 1: "running"})
MODE = Point("mode", Area.HOLDING, 9, labels={0: "hand", 1: "auto", 7: "don't"}, write="yes")
SPEED = Point("speed", Area.HOLDING, 10, "int32", count=2, scale=0.1, decimals=1, unit="rpm", write="yes")
FLAP = Point("flap", Area.HOLDING, 12, scale=-0.5, unit="%", write="yes")
TARGET = Point("target", Area.HOLDING, 14, "float64", count=4, decimals=5, unit="degC", write="yes")
VALVE = Point("valve", Area.COILS, 3, "bit", write="yes")
GATE = Point("gate", Area.COILS, 4, "bit", labels={1: "up"}, write="yes")
LIMIT = Point("limit", Area.DISCRETE, 3, "bit")
DOOR = Point("door", Area.DISCRETE, 4, "bit", labels={1: "open", 0: "closed"})
NAME = Point("name", Area.HOLDING, 20, "string", count=4, write="yes")
SERIAL = Point("serial", Area.INPUT, 20, "string", count=4)
ENERGY = Point("energy", Area.INPUT, 30, "uint32", count=2, unit="kWh")
BALANCE = Point("balance", Area.INPUT, 32, "int32", count=2, unit="kWh")
ACID = Point("acid", Area.INPUT, 34, scale=0.01, decimals=2, unit="pH")
ZERO = Point("zero", Area.HOLDING, 40, labels={187: "take"}, write="only")
PUMP = Point("pump", Area.HOLDING, 50, bits=(3, 3), write="yes")
ALARM = Point("alarm", Area.INPUT, 50, bits=(15, 15))
TRIP = Point("trip", Area.INPUT, 50, bits=(14, 14), labels={0: "fine", 1: "tripped"})
STAGE = Point("stage", Area.HOLDING, 50, bits=(4, 6), labels={0: "idle", 3: "full"}, write="yes")
FAN = Point("fan", Area.HOLDING, 51, bits=(0, 2), write="yes")
LOW = Point("low", Area.INPUT, 52, "int8", bits=(0, 7), unit="°C")
COUNT = Point("count", Area.INPUT, 53, "bcd32", count=2, unit="kWh")
OUTSIDE = Point("outside", Area.HOLDING, 55, offset=-40.0, unit="°C", write="yes")
SETPOINT = Point("setpoint", Area.HOLDING, 56, scale=0.1, minimum=5, maximum=30, write="yes", write_at=156)
LIMITED = Point("limited", Area.HOLDING, 57, "int16", scale=0.1, scale_at=58, decimals=2, maximum=100, write="yes")
ONE = Point("one", Area.HOLDING, 59, minimum=7, maximum=7, write="yes")
ALL = (
    PUMP, ALARM, TRIP, STAGE, FAN, LOW, COUNT, OUTSIDE, SETPOINT, LIMITED, ONE,
    WEIGHT, STATE, MODE, SPEED, FLAP, TARGET, VALVE, GATE, LIMIT, DOOR, NAME, SERIAL, ENERGY, BALANCE, ACID, ZERO,
)  # fmt: skip


def device(*points, name="silo-1", writable=True):
    published = tuple(PublishedPoint(each, 1.0, is_writable=writable and each.write != "no") for each in points)
    return PublishedDevice(name, 41, "Weigher", published)


def announced(*points, **more):
    (message,) = DISCOVERY.messages([device(*points, **more)], {})
    return spelled_out(json.loads(message.payload))


def component(point, *, writable=True):
    return announced(point, writable=writable)["components"][point.name]


def spelled_out(config):
    """The config with the long names of its keys, as Home Assistant reads it."""
    long = {THEIRS["abbreviations"].get(key, key): value for key, value in config.items()}
    long["device"] = {THEIRS["device_abbreviations"].get(key, key): value for key, value in long["device"].items()}
    long["origin"] = {THEIRS["origin_abbreviations"].get(key, key): value for key, value in long["origin"].items()}
    long["availability"] = [
        {THEIRS["abbreviations"].get(key, key): value for key, value in each.items()} for each in long["availability"]
    ]
    long["components"] = {
        name: {THEIRS["abbreviations"].get(key, key): value for key, value in each.items()}
        for name, each in long["components"].items()
    }
    return long


def keys_fit(config, schema):
    return set(schema["required"]) <= set(config) <= {*schema["required"], *schema["optional"]}


def test_a_device_has_only_keys_that_home_assistant_knows():
    config = announced(*ALL)
    assert keys_fit(config, THEIRS["device_discovery"])
    assert keys_fit(config["device"], THEIRS["device"])
    assert keys_fit(config["origin"], THEIRS["origin"])


@pytest.mark.parametrize(
    ("point", "writable"),
    [(point, writable) for point in ALL for writable in (False, True) if writable or point is not ZERO],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_a_component_has_only_keys_that_its_platform_knows(point, writable):
    config = announced(point, writable=writable)
    component = config["components"][point.name]
    schema = THEIRS["platforms"][component.pop("platform")]
    assert set(component) <= {*schema["required"], *schema["optional"]}
    assert set(schema["required"]) <= {*component, *(key for key in THEIRS["shared"] if key in config)}


@pytest.mark.parametrize("data_type", ["float32", "uint32", "int32"])
def test_device_class_unit_and_statistics_belong_together(data_type):
    theirs = {unit for units in THEIRS["sensor_units"].values() for unit in units if unit}
    others = ["rpm", "K", "dB", "t", "Nm", "degC", "m3/h", "l/min", "kVAr", "lux", "W/m2", "1/min"]
    for unit in sorted({*theirs, *THEIRS["respelled"], *others}):
        shown = component(Point("a", Area.INPUT, 0, data_type, count=2, unit=unit))
        now = shown["unit_of_measurement"]
        assert now not in THEIRS["respelled"]
        if "device_class" in shown:
            assert now in THEIRS["sensor_units"][shown["device_class"]]
            assert now in THEIRS["number_units"][shown["device_class"]]
            assert shown["state_class"] in THEIRS["sensor_state_classes"][shown["device_class"]]


def test_home_assistant_knows_each_unit_that_gets_another_spelling():
    known = {unit for units in THEIRS["sensor_units"].values() for unit in units}
    for unit in ("degC", "m3", "m3/h", "l", "l/min", "m2", "kVAr", "VAr", "lux", "µS/cm", "W/m2"):
        assert component(Point("a", Area.INPUT, 0, unit=unit))["unit_of_measurement"] in known


@pytest.mark.parametrize(
    ("point", "platform", "more"),
    [
        (WEIGHT, "sensor", {"device_class": "weight", "state_class": "measurement", "unit_of_measurement": "kg"}),
        (WEIGHT, "sensor", {"suggested_display_precision": 2}),
        (ENERGY, "sensor", {"device_class": "energy", "state_class": "total_increasing"}),
        (BALANCE, "sensor", {"device_class": "energy", "state_class": "total"}),
        (DOOR, "sensor", {"device_class": "enum", "options": ["closed", "open"]}),
        (LIMIT, "binary_sensor", {"payload_on": "1", "payload_off": "0"}),
        (VALVE, "switch", {"payload_on": "1", "payload_off": "0"}),
        (GATE, "select", {"options": ["0", "up"]}),
        (MODE, "select", {"options": ["hand", "auto", "don't"]}),
        (NAME, "text", {"max": 8}),
        (ZERO, "button", {"payload_press": "take"}),
        (SPEED, "number", {"min": -214748364.8, "max": 214748364.7, "step": 0.1, "unit_of_measurement": "rpm"}),
        (FLAP, "number", {"min": -32767.5, "max": 0, "step": 0.5}),
        (PUMP, "switch", {"payload_on": "1", "payload_off": "0"}),
        (ALARM, "binary_sensor", {"payload_on": "1", "payload_off": "0"}),
        (TRIP, "sensor", {"device_class": "enum", "options": ["fine", "tripped"]}),
        (STAGE, "select", {"options": ["idle", "full"]}),
        (FAN, "number", {"min": 0, "max": 7, "step": 1}),
        (LOW, "sensor", {"device_class": "temperature", "state_class": "measurement"}),
        (COUNT, "sensor", {"device_class": "energy", "state_class": "total_increasing"}),
        (OUTSIDE, "number", {"min": -40, "max": 65495, "step": 1, "device_class": "temperature"}),
        (SETPOINT, "number", {"min": 5, "max": 30, "step": 0.1}),
        (LIMITED, "number", {"min": -3.4e38, "max": 100, "step": 0.01}),
        (ONE, "number", {"min": 7, "max": 8}),
        (TARGET, "number", {"step": 0.001, "unit_of_measurement": "°C", "device_class": "temperature"}),
    ],
)
def test_a_point_becomes_what_fits_it(point, platform, more):
    shown = component(point)
    assert shown["platform"] == platform
    assert {key: shown[key] for key in more} == more


def test_a_text_in_registers_of_four_bytes_is_as_long_as_they_are():
    assert component(Point("name", Area.HOLDING, 0, "string", count=5, write="yes", width=4))["max"] == 20


def test_a_label_stays_no_longer_than_its_number():
    """Home Assistant ignores a value that is not among the options, and goes on showing the one before it."""
    assert component(STATE)["platform"] == "sensor"
    assert "options" not in component(STATE)
    assert "device_class" not in component(STATE)


def test_ph_is_a_class_without_unit():
    shown = component(ACID)
    assert shown["device_class"] == "ph"
    assert "unit_of_measurement" not in shown


def test_points_that_must_not_be_written_are_only_shown():
    platforms = {each["platform"] for each in announced(*ALL, writable=False)["components"].values()}
    assert platforms == {"sensor", "binary_sensor"}


def test_points_that_can_neither_be_read_nor_written_are_left_out():
    assert "zero" in announced(*ALL)["components"]
    assert "zero" not in announced(*ALL, writable=False)["components"]


def test_topics_are_those_of_the_plain_messages():
    config = announced(SPEED)
    assert config["state_topic"] == "modbus/plant-2/silo-1"
    assert config["components"]["speed"]["command_topic"] == "modbus/plant-2/silo-1/speed/set"


def test_a_device_is_available_while_gateway_and_device_are():
    config = announced(WEIGHT)
    assert config["availability_mode"] == "all"
    assert [each["topic"] for each in config["availability"]] == [
        "modbus/plant-2/status",
        "modbus/plant-2/silo-1/availability",
    ]


def test_the_message_is_kept_by_the_broker():
    (message,) = DISCOVERY.messages([device(WEIGHT)], {})
    assert message.topic == "homeassistant/device/plant-2/silo-1/config"
    assert message.retain
    assert message.qos == 1


def test_identifiers_are_unique_and_stay():
    config = announced(*ALL)
    ids = [each["unique_id"] for each in config["components"].values()]
    assert len(set(ids)) == len(ids)
    assert announced(WEIGHT)["components"]["weight"]["unique_id"] == "modbus/plant-2/silo-1/weight"
    assert announced(WEIGHT)["device"]["identifiers"] == ["modbus/plant-2/silo-1"]


@pytest.mark.parametrize("name", ["hall-a/41", "Kühler 1", "a b", "a_b"])
def test_a_topic_has_only_characters_that_home_assistant_takes(name):
    (message,) = DISCOVERY.messages([device(WEIGHT, name=name)], {})
    *_, identifier, config = message.topic.split("/")
    assert config == "config"
    assert identifier.isascii()
    assert identifier.replace("_", "").replace("-", "").isalnum()


def test_similar_names_have_different_topics():
    names = ["a b", "a/b", "a_b", "a+b"]
    assert len({DISCOVERY.messages([device(WEIGHT, name=each)], {})[0].topic for each in names}) == len(names)


def test_a_component_that_is_gone_is_removed_first():
    before = DISCOVERY.announced([device(WEIGHT, SPEED)])
    removal, present = DISCOVERY.messages([device(WEIGHT)], before)
    assert json.loads(removal.payload)["cmps"]["speed"] == {"p": "number"}
    assert "weight" in json.loads(removal.payload)["cmps"]
    assert list(json.loads(present.payload)["cmps"]) == ["weight"]
    assert removal.topic == present.topic


def test_a_component_that_changes_its_platform_is_removed_first():
    before = DISCOVERY.announced([device(SPEED)])
    removal, present = DISCOVERY.messages([device(SPEED, writable=False)], before)
    assert json.loads(removal.payload)["cmps"]["speed"] == {"p": "number"}
    assert json.loads(present.payload)["cmps"]["speed"]["p"] == "sensor"


def test_nothing_is_removed_when_nothing_has_changed():
    assert len(DISCOVERY.messages([device(*ALL)], DISCOVERY.announced([device(*ALL)]))) == 1


@pytest.mark.parametrize("point", [each for each in ALL if each is not ZERO], ids=lambda point: point.name)
def test_templates_find_the_value_by_its_name(point):
    shown = component(point)
    assert f"value_json['{point.name}']" in shown["value_template"]
    assert "default(" in shown["value_template"]


@pytest.mark.parametrize("point", [each for each in ALL if each.write != "only"], ids=lambda point: point.name)
@pytest.mark.parametrize("writable", [True, False])
@pytest.mark.parametrize("values", [{}, None])
def test_a_value_that_is_missing_or_null_is_unknown(point, writable, values):
    """Home Assistant renders templates with jinja2, and takes "None" for unknown; text is empty then."""
    shown = component(point, writable=writable)
    value_json = {point.name: None} if values is None else values
    rendered = Environment(autoescape=True).from_string(shown["value_template"]).render(value_json=value_json)
    assert rendered == ("" if shown["platform"] == "text" else "None")


@pytest.mark.parametrize(
    ("unit", "device_class"),
    [
        ("V", "voltage"), ("A", "current"), ("W", "power"), ("kW", "power"), ("var", "reactive_power"),
        ("VA", "apparent_power"), ("Hz", "frequency"), ("kWh", "energy"), ("Wh", "energy"), ("kPa", "pressure"),
        ("kvarh", "reactive_energy"),
        ("°C", "temperature"), ("bar", "pressure"), ("m³/h", "volume_flow_rate"), ("l/h", "volume_flow_rate"),
        ("W/m²", "irradiance"), ("kg", "weight"), ("m/s", "speed"), ("lx", "illuminance"), ("GJ", "energy"),
        ("%", None), ("rpm", None), ("m³", None), ("°", None), ("kvar", "reactive_power"), ("kVA", "apparent_power"),
        ("h", "duration"), ("s", "duration"), ("mA", "current"), ("MWh", "energy"), ("ppm", None), ("K", None),
    ],
)  # fmt: skip
def test_the_units_of_the_library_have_their_classes(unit, device_class):
    shown = component(Point("a", Area.INPUT, 0, unit=unit))
    assert shown.get("device_class") == device_class


def test_the_maker_is_told_if_the_profile_names_it():
    (message,) = DISCOVERY.messages([replace(device(WEIGHT), maker="Laumas")], {})
    told = spelled_out(json.loads(message.payload))["device"]
    assert (told["manufacturer"], told["model"]) == ("Laumas", "Weigher")
    assert "manufacturer" not in announced(WEIGHT)["device"]
