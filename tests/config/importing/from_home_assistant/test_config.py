"""The `modbus:` section of Home Assistant becomes a config that passes its checks, also with the suggested [mqtt]."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.importing.from_home_assistant.config import config_from_home_assistant
from gateway.config.importing.imported import Imported, ImportedFileError
from gateway.config.load import parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve
from gateway.plant.discovery import Discovery
from gateway.plant.topics import Topics

HEATING = """
homeassistant:
  packages: !include_dir_named packages
automation: !include automations.yaml
modbus:
  - name: Heating
    type: serial
    port: /dev/ttyUSB0
    baudrate: 9600
    bytesize: 8
    method: rtu
    parity: N
    stopbits: 1
    delay: 2
    message_wait_milliseconds: 50
    timeout: 5
    sensors:
      - name: Outdoor
        slave: 2
        address: 0x10
        scale: 0.1
        precision: 1
        unit_of_measurement: °C
        unique_id: o
        device_class: temperature
      - {name: Energy, device_address: 3, address: 4, data_type: uint32, swap: word, input_type: input}
    switches:
      - {name: Pump, slave: 3, address: 0, write_type: coil, verify: }
"""
SOLAR = """
- name: Solar inverter
  type: tcp
  host: !secret inverter
  port: !secret port
  delay: 1
  sensors: !include sensors.yaml
- name: Old bridge
  type: rtuovertcp
  host: 10.0.0.7
  port: 8899
  message_wait_milliseconds: 30
  binary_sensors:
    - {name: Door, address: 3, input_type: discrete_input}
- name: Weigher
  type: serial
  method: ascii
  port: socket://10.0.0.8:4001
  baudrate: 19200
  bytesize: 7
  parity: E
  stopbits: 1
  sensors:
    - {name: Weight, address: 1, data_type: float32, scan_interval: 0}
"""
FILES = {
    "conf/configuration.yaml": "modbus: !include solar.yaml\n",
    "conf/solar.yaml": SOLAR,
    "conf/secrets.yaml": "inverter: 192.168.1.5\nport: 1502\n",
    "conf/sensors.yaml": "- {name: Power, address: 5016, data_type: uint32, swap: word}\n- {name: Power, address: 7}\n",
}


def check(text):
    return parse(text, port_trouble=lambda _: None).problems


def read_from(files: dict[str, str]):
    def read(path: str) -> str:
        if path not in files:
            raise ImportedFileError(f"{path}: there is no such file")
        return files[path]

    return read


def imported(text: str) -> Imported:
    return config_from_home_assistant("c.yaml", check, read_from({"c.yaml": text}))


def plan_of(text: str) -> Plan:
    loaded = parse(text, port_trouble=lambda _: None)
    assert loaded.problems == (), f"{text}\n" + "\n".join(map(str, loaded.problems))
    return resolve(loaded.config)


def with_mqtt(text: str) -> str:
    """Follow the suggestion: the comments of [mqtt] and of the site become keys."""
    before, heading, after = text.partition("# [mqtt]\n")
    return before.replace('# site = "home"', 'site = "home"') + re.sub("(?m)^# ", "", heading + after)


def section(*hubs: str) -> str:
    return "modbus:\n" + "".join(f"  - {hub}\n" for hub in hubs)


def entity(kind: str, keys: str) -> str:
    return section(f"{{name: h, type: tcp, host: 10.0.0.1, port: 502, {kind}: [{{{keys}}}]}}")


def points_of(kind: str, keys: str) -> dict:
    """The points of one entity, by their names."""
    profile = imported(entity(kind, keys))
    assert profile.left_out == ()
    plan = plan_of(profile.text)
    (device,) = plan.upstreams[0].devices
    return {point.name: point for point in plan.points[device.known_as]}


def refusal(kind: str, keys: str) -> str:
    """Why an entity is left out, of a config in which another one is understood."""
    hub = "name: h, type: tcp, host: 10.0.0.1, port: 502, switches: [{name: fine, address: 1}]"
    hub = f"{{{hub}, {kind}: [{{{keys}}}]}}".replace(
        "switches: [{name: fine, address: 1}], switches: [", "switches: [{name: fine, address: 1}, "
    )
    profile = imported(section(hub))
    (why,) = profile.left_out
    assert f"  # {why}\n" in profile.text
    assert [len(points) for points in plan_of(profile.text).points.values()] == [1]
    return why


def test_a_serial_connection_is_a_line_with_a_device_for_each_unit():
    text, left_out, _ = imported(HEATING)
    plan = plan_of(text)
    (line,) = plan.lines
    assert left_out == ()
    assert (line.port.port, line.port.baud, str(line.port.format)) == ("/dev/ttyUSB0", 9600, "8N1")
    assert [(each.unit, each.name) for each in line.devices] == [(2, "heating-2"), (3, "heating-3")]
    assert {each.answer_time.timeout for each in line.devices} == {5.0}
    (outdoor,) = plan.points[2]
    assert (outdoor.name, outdoor.address, outdoor.type, outdoor.scale, outdoor.unit) == (
        "outdoor",
        16,
        "int16",
        0.1,
        "°C",
    )
    energy, pump = plan.points[3]
    assert (energy.area, energy.type, energy.swap) == ("input", "uint32", "words")
    assert (pump.area, pump.write) == ("coils", "yes")


def test_connections_over_tcp_are_upstreams_and_lines_and_files_and_secrets_are_followed():
    text, left_out, _ = config_from_home_assistant("conf/configuration.yaml", check, read_from(FILES))
    plan = plan_of(text)
    assert left_out == ()
    (solar,) = plan.upstreams
    assert (solar.port.host, solar.port.number, solar.port.after_connect) == ("192.168.1.5", 1502, 1.0)
    assert solar.upstream.in_flight == 1
    assert [point.name for point in plan.points[1]] == ["power", "power-2"]
    assert [line.port.port for line in plan.lines] == ["rtu+tcp://10.0.0.7:8899", "ascii+tcp://10.0.0.8:4001"]
    # All of them are unit 1, which clients can have once.
    assert [device.client_unit for each in (*plan.upstreams, *plan.lines) for device in each.devices] == [1, None, None]


def test_the_suggested_mqtt_brings_the_entities_back():
    text = SOLAR.replace("!secret inverter", "10.0.0.1").replace("!secret port", "502")
    several = (
        "[{name: a, address: 1, scan_interval: 2}, {name: b, address: 2}, {name: c, address: 3, scan_interval: 0}]"
    )
    plan = plan_of(with_mqtt(imported(text.replace("!include sensors.yaml", several)).text))
    bridge, solar = plan.mqtt.devices  # nobody asks the weigher
    assert {each.point.name: each.every for each in solar.points} == {"a": 2.0, "b": 15.0}
    assert {each.point.name: each.every for each in bridge.points} == {"door": 15.0}
    (message,) = Discovery(Topics(plan.mqtt.site), "homeassistant").messages([bridge], {})
    assert '"p":"binary_sensor"' in message.payload.decode()


def test_places_are_those_of_the_file():
    text = imported(HEATING.replace("0x10", "up")).text
    assert "\n# c.yaml:6\n[[line]]\n" in text
    assert '  # c.yaml:18: sensor "Outdoor": address must be a whole number\n' in text


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("address: 7", {"type": "int16", "area": "holding"}),
        ("address: 7, input_type: input, data_type: float32", {"type": "float32", "area": "input"}),
        ("address: 7, data_type: float64, swap: word_byte", {"type": "float64", "swap": "both"}),
        ("address: 7, data_type: uint16, swap: byte", {"type": "uint16", "swap": "bytes"}),
        ("address: 7, data_type: uint16, swap: word", {"type": "uint16", "swap": "none"}),
        ("address: 7, data_type: string, count: 8", {"type": "string", "count": 8}),
        ("address: 7, data_type: int, count: 2", {"type": "int32"}),
        ("address: 7, data_type: uint, count: 4", {"type": "uint64"}),
        ("address: 7, data_type: float", {"type": "float32"}),
        ("address: 7, count: 2", {"type": "int32"}),
        ("address: 7, data_type: uint32, reverse_order: true", {"swap": "words"}),
        ("address: 7, scale: 0.1, offset: -40, precision: 1", {"scale": 0.1, "offset": -40, "decimals": 1}),
        ("address: 7, nan_value: 0x8000", {"invalid": (-32768,)}),
        ("address: 7, nan_value: '0x8000'", {"invalid": (-32768,)}),
        ("address: '7', slave: '1'", {"address": 7}),
        ("address: 010", {"address": 8}),  # octal, as for Home Assistant
        ("address: 7, data_type: custom, count: 2, structure: '>f'", {"type": "float32", "swap": "none"}),
        ("address: 7, data_type: custom, count: 2, structure: '<i'", {"type": "int32", "swap": "both"}),
        ("address: 7, data_type: custom, count: 1, structure: 'H'", {"type": "uint16", "swap": "bytes"}),
        ("address: 7, data_type: custom, count: 1, structure: '>xB'", {"type": "uint8", "bits": (0, 7)}),
        ("address: 7, data_type: custom, count: 4, structure: '>8s'", {"type": "string", "count": 4}),
        ("address: 7, scan_interval: 1, unique_id: u, state_class: total, lazy_error_count: 3", {"address": 7}),
    ],
)
def test_a_sensor(keys, expected):
    (point,) = points_of("sensors", f"name: a, {keys}").values()
    assert {key: getattr(point, key) for key in expected} == expected


def test_a_structure_of_several_values_is_several_points():
    points = points_of("sensors", "name: a, address: 7, data_type: custom, count: 5, structure: '>2f xb', scale: 2")
    assert {name: (point.address, point.type, point.scale) for name, point in points.items()} == {
        "a": (7, "float32", 2),
        "a-1": (9, "float32", 2),
        "a-2": (11, "int8", 2),
    }


@pytest.mark.parametrize(
    ("kind", "keys", "places"),
    [
        ("sensors", "data_type: uint32, virtual_count: 2", [("holding", 7), ("holding", 9), ("holding", 11)]),
        ("sensors", "slave_count: 1", [("holding", 7), ("holding", 8)]),
        ("binary_sensors", "slave_count: 2", [("coils", 7), ("coils", 8), ("coils", 9)]),
        ("binary_sensors", "input_type: discrete_input", [("discrete", 7)]),
        ("binary_sensors", "input_type: holding, virtual_count: 1", [("holding", 7), ("holding", 8)]),
    ],
)
def test_virtual_entities_are_points_of_their_own(kind, keys, places):
    points = points_of(kind, f"name: a, address: 7, {keys}")
    assert [*points] == ["a", *(f"a-{number}" for number in range(1, len(places)))]
    assert [(point.area, point.address) for point in points.values()] == places


def test_a_binary_sensor_in_a_register_is_its_lowest_bit():
    (point,) = points_of("binary_sensors", "name: a, address: 7, input_type: input").values()
    assert point.bits == (0, 0)


def written(point) -> tuple:
    return point.area, point.address, point.write, point.write_at, dict(point.labels)


@pytest.mark.parametrize("kind", ["switches", "fans", "lights"])
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("verify: ", {"a": ("holding", 7, "yes", None, {1: "on", 0: "off"})}),
        ("write_type: coil, verify: {}", {"a": ("coils", 7, "yes", None, {})}),
        (
            "write_type: coil, command_on: 0, command_off: 1, verify: ",
            {"a": ("coils", 7, "yes", None, {0: "on", 1: "off"})},
        ),
        ("command_on: 0xAA, command_off: 0x55", {"a": ("holding", 7, "only", None, {0xAA: "on", 0x55: "off"})}),
        ("verify: {address: 9}", {"a": ("holding", 9, "yes", 7, {1: "on", 0: "off"})}),
        (
            "verify: {address: 9, state_on: [25, 26], state_off: 1}",
            {
                "a": ("holding", 9, "no", None, {25: "on", 26: "on (26)", 1: "off"}),
                "a-command": ("holding", 7, "only", None, {1: "on", 0: "off"}),
            },
        ),
        (
            "write_type: coil, verify: {input_type: discrete_input, address: 3}",
            {"a": ("discrete", 3, "no", None, {}), "a-command": ("coils", 7, "only", None, {})},
        ),
    ],
)
def test_a_switch(kind, keys, expected):
    assert {name: written(point) for name, point in points_of(kind, f"name: a, address: 7, {keys}").items()} == expected


@pytest.mark.parametrize("write_type", ["holdings", "coils"])
def test_a_plural_is_written_by_the_function_for_several(write_type):
    (point,) = points_of("switches", f"name: a, address: 7, write_type: {write_type}, verify: ").values()
    assert point.write_function == "multiple"


def test_a_light_may_have_a_brightness():
    points = points_of("lights", "name: a, address: 7, brightness_address: 8, color_temp_address: 9, verify: ")
    assert [*points] == ["a", "a-brightness", "a-color-temperature"]
    brightness = points["a-brightness"]
    assert (brightness.address, brightness.minimum, brightness.maximum, brightness.unit) == (8, 0, 100, "%")


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("address: 7", {"a": ("holding", 7, "yes", None, {0: "closed", 1: "open", 2: "opening", 3: "closing"})}),
        ("address: 7, input_type: coil", {"a": ("coils", 7, "yes", None, {0: "closed", 1: "open"})}),
        (
            "address: 7, input_type: coil, status_register: 9, status_register_type: input, state_open: 5",
            {
                "a": ("input", 9, "no", None, {0: "closed", 5: "open", 2: "opening", 3: "closing"}),
                "a-command": ("coils", 7, "only", None, {0: "closed", 1: "open"}),
            },
        ),
    ],
)
def test_a_cover(keys, expected):
    assert {name: written(point) for name, point in points_of("covers", f"name: a, {keys}").items()} == expected


def test_a_climate():
    points = points_of(
        "climates",
        "name: a, address: 10, input_type: input, scale: 0.1, target_temp_register: 20, target_temp_scale: 0.5, "
        "target_temp_write_registers: true, max_temp: 30, min_temp: 5, max_temp: 35, temperature_unit: F, "
        "hvac_mode_register: {address: 11, values: {state_off: [0, 5], state_heat: 2}}, "
        "hvac_onoff_register: 12, hvac_on_value: 3, fan_mode_register: {address: [13], values: {state_fan_low: 1}}, "
        "swing_mode_register: {address: 14, values: {swing_mode_state_on: 1}}, "
        "hvac_action_register: {address: 15, input_type: input, values: {action_heating: 1}}",
    )
    assert [*points] == ["a-temperature", "a-setpoint", "a-on", "a-mode", "a-fan", "a-swing", "a-action"]
    temperature, setpoint = points["a-temperature"], points["a-setpoint"]
    assert (temperature.area, temperature.address, temperature.scale, temperature.unit) == ("input", 10, 0.1, "°F")
    assert (setpoint.area, setpoint.scale, setpoint.minimum, setpoint.maximum) == ("holding", 0.5, 5, 35)
    assert setpoint.write_function == "multiple"
    assert {name: written(point)[-1] for name, point in points.items() if point.labels} == {
        "a-on": {3: "on", 0: "off"},
        "a-mode": {0: "off", 5: "off (5)", 2: "heat"},
        "a-fan": {1: "low"},
        "a-swing": {1: "on"},
        "a-action": {1: "heating"},
    }
    assert (points["a-fan"].write_function, points["a-action"].write) == ("multiple", "no")


def test_a_climate_may_have_a_setpoint_for_each_mode():
    points = points_of("climates", "name: a, address: 1, target_temp_register: [2, 4, 4, 4, 3, 3, 3]")
    assert {name: point.address for name, point in points.items()} == {
        "a-temperature": 1,
        "a-setpoint-auto": 2,
        "a-setpoint-cool": 4,
        "a-setpoint-heat": 3,
    }


@pytest.mark.parametrize(
    ("kind", "keys", "why"),
    [
        ("sensors", "name: a", "it has no address"),
        ("sensors", "name: a, address: 7, data_type: float16", "data_type float16 is not known here"),
        ("sensors", "name: a, address: 7, swap: maybe", "swap maybe is not known here"),
        ("sensors", "name: a, address: 7, input_type: coil", "input_type coil is not possible here"),
        ("sensors", "name: a, address: 7, scale: much", "scale must be a number"),
        ("sensors", "name: a, address: 7, nan_value: x", "nan_value must be a number"),
        ("sensors", "name: a, address: 7, data_type: custom, structure: '>hx'", "no whole number of registers"),
        ("sensors", "name: a, address: 7, data_type: custom, structure: '>xhx'", "begins or ends within a register"),
        (
            "sensors",
            "name: a, address: 7, data_type: custom, count: 4, structure: 'l'",
            "is 2 registers here, and count",
        ),
        ("sensors", "name: a, address: 7, data_type: custom, count: 4, structure: 'hi'", "is 3 registers here, and"),
        ("sensors", "name: a, address: 7, data_type: custom, structure: '>e'", "e is not known here"),
        ("sensors", "name: a, address: 7, data_type: custom, structure: '?!'", "is not understood"),
        ("sensors", "name: a, address: !secret x", "address: c.yaml"),
        ("sensors", "name: a, address: !lambda x", "address: !lambda is not known here"),
        ("sensors", "name: a, address: 7, virtual_count: 9999", "virtual_count is at most"),
        ("sensors", "name: a, address: 65535, data_type: uint32", "the point ends at 65536"),
        ("sensors", "name: a, address: 7, device_address: 256", "256 is no unit"),
        ("sensors", "name: [a], address: 7", "name must be text"),
        ("switches", "name: a, address: 7, verify: 3", "verify must be a table"),
        ("climates", "name: a, address: 7, target_temp_register: [1, 2]", "one for each of seven modes"),
    ],
)
def test_an_entity_that_cannot_be_is_a_comment_at_its_place(kind, keys, why):
    said = refusal(kind, keys)
    assert said.startswith("c.yaml:2: ")
    assert why.replace("address: c.yaml", "address: secrets.yaml: there is no such file") in said


@pytest.mark.parametrize(
    ("hub", "why"),
    [
        (
            "{name: h, type: udp, host: 10.0.0.1, port: 502, sensors: [{name: a, address: 1}]}",
            "type udp is not known here",
        ),
        ("{name: h, sensors: [{name: a, address: 1}]}", "it has no type"),
        ("{name: h, type: tcp, port: 502, sensors: [{name: a, address: 1}]}", "it has no host"),
        ("{name: h, type: tcp, host: 10.0.0.1, sensors: [{name: a, address: 1}]}", "it has no port"),
        ("{name: h, type: tcp, host: 'a b', port: 502, sensors: [{name: a, address: 1}]}", "host"),
        ("{name: h, type: tcp, host: 10.0.0.1, port: 502}", "it has no entities"),
        ("{name: h, type: tcp, host: 10.0.0.1, port: 70000, sensors: [{name: a, address: 1}]}", "70000 is no port"),
        (
            "{name: h, type: tcp, host: 10.0.0.1, port: 502, sensors: !include_dir_list x}",
            "import its files one by one",
        ),
        ("{name: h, type: tcp, host: 10.0.0.1, port: 502, sensors: !include ../x}", "not below the folder"),
        (
            "{name: h, type: tcp, host: 10.0.0.1, port: 502, delay: -1, sensors: [{name: a, address: 1}]}",
            "delay must be",
        ),
        (
            "{name: h, type: tcp, host: 10.0.0.9, port: 502, sensors: [{name: a, address: 1}]}",
            "is the connection of c.yaml:2",
        ),
        (
            "{name: h, type: serial, port: COM3, baudrate: 9600, sensors: [{name: a, address: 1}]}",
            "is not an absolute path",
        ),
        (
            "{name: h, type: serial, port: /dev/ttyS0, baudrate: 9600, bytesize: 7, sensors: [{name: a, address: 1}]}",
            "cannot have 9600 Bd and 7E1",
        ),
        ("{name: h, type: serial, port: /dev/ttyS0, method: tls, baudrate: 1}", "method tls is not known here"),
        (
            "{name: h, type: serial, port: /dev/ttyS0, baudrate: 9600, sensors: [{name: a, address: 1, slave: 0}]}",
            "unit 0 is that of all devices on a line",
        ),
        ("word", "this must be a table"),
    ],
)
def test_a_connection_that_cannot_be_is_left_out_and_the_others_are_not(hub, why):
    fine = "{name: fine, type: tcp, host: 10.0.0.9, port: 502, sensors: [{name: a, address: 1}]}"
    text, (said,), _ = imported(section(fine, hub))
    assert why in said
    assert f"\n# Left out: {said}\n" in text
    assert len(plan_of(text).upstreams) == 1


def test_unit_0_behind_a_server_is_a_unit():
    text = imported(entity("sensors", "name: a, address: 1, slave: 0")).text
    (device,) = plan_of(text).upstreams[0].devices
    assert (device.unit, device.client_unit) == (0, None)


def test_what_is_not_read_is_said_and_what_has_no_meaning_is_not():
    text = imported(
        entity("sensors", "name: a, address: 1, unique_id: u, colour: red, zero_suppress: 0.5, max_value: 80")
    ).text
    assert "ignored: colour\n" in text
    assert "Home Assistant: values beyond were lowered to 80, made 0 up to 0.5; here" in text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a: 1\n",
        "modbus:\n",
        "modbus: []\n",
        "- 1\n",
        "modbus: {x: [",
        "\t",
        "a: &a [*a]\n",
        "modbus: &a [*a]\n",
        "modbus: !include c.yaml\n",
    ],
)
def test_a_file_of_which_nothing_can_be_used_is_an_error_that_names_it(text):
    with pytest.raises(ImportedFileError, match=r"c\.yaml|a table"):
        imported(text)


def test_what_is_nested_too_deeply_is_said():
    with pytest.raises(ImportedFileError, match=r"c\.yaml: is nested too deeply"):
        imported(f"modbus: {'[' * 5000}{']' * 5000}")


def test_anchors_and_merges_are_followed_and_what_grows_by_them_is_limited():
    sensors = "[&a {name: a, address: 1, scale: 2}, {<<: *a, name: b, address: 2}]"
    text = section(f"{{name: h, type: tcp, host: 10.0.0.1, port: 502, sensors: {sensors}}}")
    points = plan_of(imported(text).text).points[1]
    assert [(point.name, point.address, point.scale) for point in points] == [("a", 1, 2), ("b", 2, 2)]
    sensors = f"&s [{', '.join(['{name: a, address: 1, virtual_count: 2000}'] * 50)}]"
    hubs = [f"{{name: h, type: tcp, host: 10.0.0.{number}, port: 502, sensors: *s}}" for number in range(1, 50)]
    with pytest.raises(ImportedFileError, match="there are more than 10000 points"):
        imported(section(f"{{name: h, type: tcp, host: 10.0.0.100, port: 502, sensors: {sensors}}}", *hubs))


def huge() -> str:
    """A list that would have 10 to the power of 30 elements, written out."""
    text = "&a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"
    for number in range(1, 30):
        text = f"&a{number} [{text}{f', *a{number - 1}' * 9}]"
    return text


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        (f"address: {huge()}", "address must be a whole number"),
        (f"address: 1, scale: {huge()}", "scale must be a number"),
        (f"address: 1, nan_value: [{huge()}]", "nan_value must be a number"),
        (f"address: !include {huge()}", "!include names nothing"),
        (f"address: 1, nan_value: [!secret {huge()}]", "nan_value must be a number"),
    ],
    ids=["a whole number", "a number", "a pattern", "a file", "a secret in a list"],
)
def test_a_list_that_grows_by_anchors_is_not_written_out(keys, why):
    assert why in refusal("sensors", f"name: x, {keys}")


KEYS = st.sampled_from(
    [
        "address",
        "slave",
        "data_type",
        "count",
        "swap",
        "scale",
        "offset",
        "precision",
        "input_type",
        "write_type",
        "verify",
        "command_on",
        "structure",
        "nan_value",
        "virtual_count",
        "scan_interval",
        "status_register",
        "target_temp_register",
        "hvac_mode_register",
        "unit_of_measurement",
    ]
)
VALUES = st.sampled_from(
    [
        "1",
        "0",
        "65535",
        "-1",
        "0x10",
        "int16",
        "uint32",
        "float32",
        "string",
        "custom",
        "word",
        "byte",
        "word_byte",
        "holding",
        "input",
        "coil",
        "coils",
        "discrete_input",
        ">f",
        ">2h",
        "<i",
        "''",
        "{}",
        "[]",
        "[1,2]",
        "{address: 1}",
        "x",
        "0.1",
        "1e9",
        "true",
        "null",
    ]
)


@given(
    kind=st.sampled_from(["sensors", "binary_sensors", "switches", "lights", "fans", "covers", "climates"]),
    entities=st.lists(st.dictionaries(KEYS, VALUES, max_size=6), min_size=1, max_size=3),
)
def test_whatever_the_file_says_the_config_passes_its_checks(kind, entities):
    rows = ", ".join(
        "{" + ", ".join([f"name: a{index}", *(f"{key}: {value}" for key, value in each.items())]) + "}"
        for index, each in enumerate(entities)
    )
    try:
        text = imported(section(f"{{name: h, type: tcp, host: 10.0.0.1, port: 502, {kind}: [{rows}]}}")).text
    except ImportedFileError:
        return
    plan_of(text)
    plan_of(with_mqtt(text))


def test_where_a_file_is_no_yaml_is_said():
    with pytest.raises(ImportedFileError, match=r"^c\.yaml: line 3, column 8: mapping values are not allowed here$"):
        imported("modbus:\n- name: a\n   port: 502\n")
