"""A config of modbus-proxy becomes one of ours, which passes its checks."""

import json
import sys
from contextlib import suppress

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.config.importing.from_modbus_proxy import config_from_modbus_proxy
from gateway.config.importing.imported import Imported, ImportedFileError
from gateway.config.load import parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve

#: As its documentation describes it.
ONE = """
devices:
- modbus:
    url: plc1.acme.org:1502      # device url
    timeout: 5
    connection_time: 0.1
  listen:
    bind: 0:9000
logging:
  version: 1
"""
REMAPPED = """
devices:
- modbus:
    url: plc1.acme.org:502
  listen:
    bind: 0:9000
  unit_id_remapping:
    1: 0
    250: 7
- modbus: {url: "plc2.acme.org:502"}
  listen: {bind: ":9001"}
logging:
  version: 1
"""
TWO = """
devices:
- modbus: {url: "plc1.acme.org:502"}
  listen: {bind: ":9000"}
- modbus: {url: "tcp://plc2.acme.org:502"}
  listen: {bind: "tcp://0:9001"}
"""
LINES = """
devices:
- modbus: {url: "serial:///dev/ttyUSB0?baudrate=19200&parity=E", timeout: 2, connection_time: 1}
  listen: {bind: "0:9000"}
- modbus: {url: /dev/ttyS1}
  listen: {bind: "0:9001"}
- modbus: {url: "tcp+rtu://10.0.0.7:4001", connection_time: 0.5}
  listen: {bind: "0:9002"}
- modbus: {url: "rtu+tcp://10.0.0.8:4001"}
  listen: {bind: "0:9003"}
- modbus: {url: "ascii+tcp://10.0.0.9:4001"}
  listen: {bind: "0:9004"}
"""


def imported(text: str) -> Imported:
    return config_from_modbus_proxy("p.yml", text)


def plan_of(text: str) -> Plan:
    loaded = parse(text, port_trouble=lambda _: None)
    assert loaded.config is not None, f"{text}\n" + "\n".join(map(str, loaded.problems))
    return resolve(loaded.config)


def leads_to(plan: Plan) -> list[tuple[str, int, str, str]]:
    """The listeners: what is spoken there, their ports, and their line or upstream."""
    return [(one.scheme, one.port, one.line, one.upstream) for one in plan.listeners]


def test_a_device_becomes_an_upstream_with_a_listener_for_it():
    text, left_out, _ = imported(ONE)
    plan = plan_of(text)
    (listener,), (upstream,) = plan.listeners, plan.upstreams
    assert (listener.scheme, listener.host, listener.port, listener.idle) == ("tcp", "0.0.0.0", 9000, 0.0)
    assert (upstream.port.host, upstream.port.number) == ("plc1.acme.org", 1502)
    assert ({one.answer_time.timeout for one in upstream.unnamed}, upstream.upstream.in_flight) == ({5.0}, 1)
    assert (upstream.port.after_connect, upstream.upstream.max_wait, upstream.upstream.retries) == (0.1, 60.0, 1)
    assert left_out == ()


@pytest.mark.parametrize("text", [ONE, TWO, REMAPPED, REMAPPED.replace("1: 0", "1: 2")])
def test_nothing_is_left_to_mend(text):
    """No problem but that a unit has two numbers, as before, and no remark but those of writes and a lost unit."""
    written, left_out, _ = imported(text)
    problems = [one.what.partition(" already ")[0] for one in parse(written, port_trouble=lambda _: None).problems]
    assert problems == [f"unit {unit} behind the server" for unit in (2, 7) if f": {unit}\n" in text]
    assert left_out == ()
    remarks = [line for line in written.splitlines() if line.startswith("# ") and "p.yml" not in line][:-2]
    lost = ["# clients cannot ask for unit 0 any more"] if "1: 2" in text else []
    assert remarks == ["# modbus-proxy repeated writes too; here only reads are sent again", *lost]


def test_clients_of_several_devices_keep_all_unit_identifiers():
    plan = plan_of(imported(TWO).text)
    assert leads_to(plan) == [("tcp", 9000, "", "plc1.acme.org-502"), ("tcp", 9001, "", "plc2.acme.org-502")]
    assert [one.devices for one in plan.upstreams] == [(), ()]
    assert [[unit.unit for unit in one.unnamed] for one in plan.upstreams] == [[*range(256)]] * 2
    assert {each.answer_time.timeout for one in plan.upstreams for each in one.unnamed} == {10.0}


def test_remapped_units_keep_their_numbers_for_clients():
    plan = plan_of(imported(REMAPPED).text)
    assert leads_to(plan) == [("tcp", 9000, "", ""), ("tcp", 9001, "", "plc2.acme.org-502")]
    remapped, other = plan.upstreams
    units = {device.known_as: device.unit for device in remapped.devices}
    assert units == {unit: unit for unit in range(2, 256)} | {1: 0, 250: 7}
    assert plan.listeners[0].unit0 == 1  # it stands for the server's unit 0 too
    assert other.devices == ()


@pytest.mark.parametrize(("remapped", "unit0"), [("0: 7, 8: 7", 7), ("0: 0", "refuse"), ("255: 0", 255)])
def test_unit_0_is_kept_if_another_unit_can_stand_for_it(remapped, unit0):
    text = imported(REMAPPED.replace("1: 0", remapped.replace(", ", "\n    "))).text
    assert plan_of(text).listeners[0].unit0 == unit0
    assert ("clients cannot ask for unit 0 any more" in text) == (unit0 == "refuse")


def test_a_second_device_with_remapped_units_is_left_out_and_that_is_said():
    second = '- modbus: {url: 10.0.0.9}\n  listen: {bind: ":9009"}\n  unit_id_remapping: {1: 2}\nlogging:'
    text, left_out, _ = imported(REMAPPED.replace("logging:", second))
    said = "p.yml: device 3: unit_id_remapping: a gateway can do that for one device only"
    assert left_out == (said,)
    assert f"\n# Left out: {said}\n" in text
    assert len(plan_of(text).listeners) == 2


def test_what_is_no_modbus_tcp_becomes_a_line_with_a_listener_for_it():
    text, left_out, _ = imported(LINES)
    plan = plan_of(text)
    assert leads_to(plan) == [
        ("rtu+tcp", 9000, "ttyUSB0", ""),
        ("rtu+tcp", 9001, "ttyS1", ""),
        ("rtu+tcp", 9002, "10.0.0.7-4001", ""),
        ("rtu+tcp", 9003, "10.0.0.8-4001", ""),
        ("ascii+tcp", 9004, "10.0.0.9-4001", ""),
    ]
    serial, plain, *servers = plan.lines
    assert (serial.port.port, serial.port.baud, str(serial.port.format)) == ("/dev/ttyUSB0", 19200, "8E1")
    assert (plain.port.port, plain.port.baud, str(plain.port.format)) == ("/dev/ttyS1", 9600, "8N1")
    assert [line.port.port for line in servers] == [
        "rtu+tcp://10.0.0.7:4001",
        "rtu+tcp://10.0.0.8:4001",
        "ascii+tcp://10.0.0.9:4001",
    ]
    assert [line.port.after_connect for line in servers] == [0.5, 0.0, 0.0]
    assert plan.upstreams == ()
    assert left_out == ()


def test_units_of_a_line_are_remapped_too():
    text, _, _ = imported(
        'devices: [{modbus: {url: /dev/ttyS1}, listen: {bind: ":9000"}, unit_id_remapping: {1: 7, 200: 250}}]'
    )
    (line,) = plan_of(text).lines
    units = {device.known_as: device.unit for device in line.devices}
    assert units == {1: 7} | {unit: unit for unit in range(2, 248) if unit != 200}
    assert "# clients cannot ask for units 0, 200, 248-255 any more\n" in text


@pytest.mark.parametrize(
    ("device", "why"),
    [
        ('modbus: {url: "rfc2217://10.0.0.8:4001"}', "url: rfc2217:// is not known here"),
        ('modbus: {url: "tcp:///dev/ttyUSB0"}', "url: /dev/ttyUSB0 behind an address means nothing"),
        ('modbus: {url: "serial://10.0.0.8:4001"}', "url: serial:// is not known here"),
        ("modbus: {url: plc1.acme.org, timeout: x}", "timeout must be a number of seconds"),
        ("modbus: {url: '0:9001'}", "tcp://127.0.0.1:9001 leads back to an address where clients connect"),
    ],
)
def test_a_device_that_cannot_be_used_is_left_out_and_that_is_said(device, why):
    text, left_out, _ = imported(TWO + f"- {device}\n  listen: {{bind: ':9002'}}\n")
    assert left_out == (f"p.yml: device 3: {why}",)
    assert f"\n# Left out: p.yml: device 3: {why}\n" in text
    assert len(plan_of(text).listeners) == 2


def test_what_is_not_known_is_said_at_its_place():
    device = 'modbus: {url: a, mode: x}\n  listen: {bind: ":1", tls: yes}\n  listeners: []\n'
    text, _, _ = imported(f"extra: 1\ndevices:\n- {device}")
    for key in ("extra", "mode", "tls", "listeners"):
        assert f"\n# modbus-proxy had {key}, which is not known here\n" in text


def test_toml_and_json_say_the_same():
    device = {"modbus": {"url": "10.0.0.1"}, "listen": {"bind": ":502"}}
    toml = '[[devices]]\nmodbus = { url = "10.0.0.1" }\nlisten = { bind = ":502" }\n'
    plans = [
        plan_of(config_from_modbus_proxy("p.json", json.dumps({"devices": [device]})).text),
        plan_of(config_from_modbus_proxy("p.toml", toml).text),
    ]
    assert plans[0].upstreams == plans[1].upstreams
    assert leads_to(plans[0]) == leads_to(plans[1]) == [("tcp", 502, "", "10.0.0.1-502")]


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
        ("devices: [{modbus: {url: a}, listen: {bind: 9000}}]", "p.yml: device 1: bind must be text"),
        ("devices: [{modbus: {url: 'a:x'}, listen: {bind: a}}]", "p.yml: device 1: url: Port could not be cast"),
        ("devices: [{modbus: {url: 'a b'}, listen: {bind: ':1'}}]", "p.yml: device 1: url: 'a b' is not a valid host"),
        ("devices: [{modbus: {url: a, timeout: x}, listen: {bind: a}}]", "p.yml: device 1: timeout must be a number"),
        (
            "devices: [{modbus: {url: a}, listen: {bind: a}, unit_id_remapping: {1: 256}}]",
            "p.yml: device 1: unit_id_remapping: a unit is a number from 0 to 255",
        ),
        ("a: [", "p.yml: line 1, column 5: expected"),
        ("devices: [{modbus: {url: 'x://a'}, listen: {bind: a}}]", "p.yml: device 1: url: x:// is not known here"),
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
    st.builds(
        "{}://{}".format,
        st.sampled_from(["tcp", "tcp+rtu", "tcp+tcp", "rtu+tcp", "ascii+tcp", "udp", "serial", "rfc2217"]),
        PLACES,
    ),
    st.sampled_from(["/dev/ttyS0", "/dev/ttyS1", "tcp:///dev/ttyS0", "rtu:///dev/a b"]),
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
        plan_of(config_from_modbus_proxy("p.json", json.dumps({"devices": devices})).text)
