"""A config of modbus-proxy becomes one of ours, which passes its checks."""

import json
import sys
from contextlib import suppress

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.config.from_modbus_proxy import config_from_modbus_proxy
from gateway.config.imported import ImportedFileError
from gateway.config.load import parse
from gateway.config.plan import Plan
from gateway.config.resolve import resolve

ONE = """
devices:
- modbus:
    url: plc1.acme.org:1502      # device url
    timeout: 5
    connection_time: 0.1
  listen:
    bind: 0:9000
  unit_id_remapping:
    1: 0
logging:
  version: 1
"""
TWO = """
devices:
- modbus: {url: "plc1.acme.org:502"}
  listen: {bind: ":9000"}
- modbus: {url: "tcp://plc2.acme.org:502"}
  listen: {bind: "tcp://0:9001"}
  unit_id_remapping: {1: 7, 5: 5}
"""
SERIAL = """
devices:
- modbus: {url: "serial:///dev/ttyUSB0?baudrate=19200&parity=E", timeout: 2}
  listen: {bind: "0:9000"}
- modbus: {url: "tcp+rtu://10.0.0.7:4001"}
  listen: {bind: "0:9001"}
- modbus: {url: "rfc2217://10.0.0.8:4001"}
  listen: {bind: "0:9002"}
"""


def plan_of(text: str) -> Plan:
    loaded = parse(text, port_trouble=lambda _: None)
    assert loaded.config is not None, f"{text}\n" + "\n".join(map(str, loaded.problems))
    return resolve(loaded.config)


def units(plan: Plan) -> list[dict[int, int]]:
    return [{device.known_as: device.unit for device in one.devices} for one in plan.upstreams]


def test_a_device_alone_keeps_all_its_units():
    text = config_from_modbus_proxy("p.yml", ONE)
    plan = plan_of(text)
    (listener,), (upstream,) = plan.listeners, plan.upstreams
    assert (listener.scheme, listener.host, listener.port) == ("tcp", "0.0.0.0", 9000)
    assert (upstream.port.host, upstream.port.number) == ("plc1.acme.org", 1502)
    assert (upstream.upstream.timeout, upstream.upstream.in_flight) == (5.0, 1)
    assert units(plan) == [{1: 0, 255: 255} | {unit: unit for unit in range(2, 248)}]
    assert "# there is no pause of 0.1 s after connecting here\n" in text


def test_units_of_several_devices_get_numbers_of_their_own_and_that_is_said():
    text = config_from_modbus_proxy("p.yml", TWO)
    plan = plan_of(text)
    assert [one.port for one in plan.listeners] == [9000, 9001]
    assert units(plan) == [{1: 1}, {2: 7, 5: 5}]
    assert "# clients of tcp://0.0.0.0:9001 ask for unit 2 now, which was 1\n" in text
    assert {one.upstream.timeout for one in plan.upstreams} == {10.0}


def test_serial_devices_become_lines_with_their_own_listeners():
    text = config_from_modbus_proxy("p.yaml", SERIAL)
    plan = plan_of(text)
    assert [(one.scheme, one.port, one.line) for one in plan.listeners] == [
        ("rtu+tcp", 9000, "ttyUSB0"),
        ("rtu+tcp", 9001, "10.0.0.7:4001"),
    ]
    serial, server = plan.lines
    assert (serial.port.baud, str(serial.port.format)) == (19200, "8E1")
    assert server.port.port == "rtu+tcp://10.0.0.7:4001"
    assert "# Left out: p.yaml: device 3\n#   rfc2217:// is not known here\n" in text


def test_toml_and_json_say_the_same():
    device = {"modbus": {"url": "10.0.0.1"}, "listen": {"bind": ":502"}}
    toml = '[[devices]]\nmodbus = { url = "10.0.0.1" }\nlisten = { bind = ":502" }\n'
    plans = [
        plan_of(config_from_modbus_proxy("p.json", json.dumps({"devices": [device]}))),
        plan_of(config_from_modbus_proxy("p.toml", toml)),
    ]
    assert units(plans[0]) == units(plans[1]) == [{unit: unit for unit in (*range(1, 248), 255)}]


def test_without_the_library_it_is_said_what_is_needed(monkeypatch):
    monkeypatch.setitem(sys.modules, "ruamel.yaml", None)
    with pytest.raises(ImportedFileError, match=r"pipx inject mbgw ruamel\.yaml"):
        config_from_modbus_proxy("p.yml", ONE)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "p.yml: there is no list of devices in it"),
        ("devices: []", "p.yml: there is no list of devices in it"),
        ("devices: [1]", "p.yml: device 1: it has no modbus"),
        ("devices: [{modbus: {url: a}}]", "p.yml: device 1: it has no listen"),
        ("devices: [{modbus: {}, listen: {bind: a}}]", "p.yml: device 1: it has no url"),
        ("devices: [{modbus: {url: 'a:x'}, listen: {bind: a}}]", "p.yml: device 1: url: Port could not be cast"),
        ("devices: [{modbus: {url: 'a b'}, listen: {bind: ':1'}}]", "p.yml: device 1: url: 'a b' is not a valid host"),
        ("devices: [{modbus: {url: a, timeout: x}, listen: {bind: a}}]", "p.yml: device 1: timeout must be a number"),
        (
            "devices: [{modbus: {url: a}, listen: {bind: a}, unit_id_remapping: {1: 256}}]",
            "p.yml: device 1: unit_id_remapping: a unit is a number from 0 to 255",
        ),
        ("a: [", "p.yml: while parsing"),
        ("devices: [{modbus: {url: 'x://a'}, listen: {bind: a}}]", "p.yml: there is no device that the gateway can"),
    ],
)
def test_what_cannot_be_understood_is_said(text, said):
    with pytest.raises(ImportedFileError) as error:
        config_from_modbus_proxy("p.yml", text)
    assert str(error.value).startswith(said)


HOSTS = st.sampled_from(["", "0", "10.0.0.1", "plc.example", "[::1]", "localhost", "a b"])
PORTS = st.sampled_from(["", ":0", ":502", ":9000", ":9001", ":70000"])
PLACES = st.builds("{}{}".format, HOSTS, PORTS)
URLS = st.one_of(
    PLACES,
    st.builds("{}://{}".format, st.sampled_from(["tcp", "tcp+rtu", "tcp+tcp", "udp", "serial", "rfc2217"]), PLACES),
    st.builds(
        "serial:///dev/{}?baudrate={}&parity={}".format,
        st.sampled_from(["ttyS0", "ttyUSB0", "control"]),
        st.sampled_from(["9600", "19200", "x"]),
        st.sampled_from(["N", "E", "even", "?"]),
    ),
)
UNITS = st.integers(0, 255) | st.sampled_from([1, 2, "3", 256, None])
DEVICES = st.fixed_dictionaries(
    {
        "modbus": st.fixed_dictionaries(
            {"url": URLS},
            optional={"timeout": st.sampled_from([0, 0.5, 10, None, "x"]), "connection_time": st.just(0.2)},
        ),
        "listen": st.fixed_dictionaries({"bind": PLACES}),
    },
    optional={"unit_id_remapping": st.dictionaries(st.integers(0, 255), UNITS, max_size=4)},
)


@example([{"modbus": {"url": "a"}, "listen": {"bind": ":0"}}] * 2)
@given(st.lists(DEVICES, max_size=5))
def test_whatever_it_prints_passes_check(devices):
    with suppress(ImportedFileError):
        plan_of(config_from_modbus_proxy("p.json", json.dumps({"devices": devices})))
