"""Servers that the gateway connects to: each rule with a file that breaks it."""

import pytest

from gateway.config.load import parse
from gateway.config.problem import dotted


def problems(text):
    found = parse(text, port_trouble=lambda _: None).problems
    return [
        f"{one.severity}: {dotted(one.path)}: {one.what}" + (f" | {one.remedy}" if one.remedy else "") for one in found
    ]


def upstream(to, units="[{ as = 37, unit = 7 }]", listen=""):
    bind = f'[[listen]]\nbind = "{listen}"\n' if listen else ""
    return problems(f'{bind}[[upstream]]\nto = "{to}"\nunits = {units}\n')


def errors(*arguments, **others):
    return [said for said in upstream(*arguments, **others) if said.startswith("error")]


def test_an_upstream_alone_is_something_to_serve():
    assert upstream("tcp://10.1.0.5") == []


def test_units_may_be_0_to_255_behind_the_server():
    assert upstream("tcp://10.1.0.5", '[{ as = "1-3", unit = [0, 248, 255] }]') == []
    assert upstream("tcp://10.1.0.5", '[{ as = "248-250", unit = "248-250" }]') == []
    assert upstream("tcp://10.1.0.5", "[{ as = 256, unit = 1 }]") == [
        "error: upstream[0].units[0].as: unit 256 is outside 1-255"
    ]


def test_as_many_units_on_both_sides():
    assert upstream("tcp://10.1.0.5", '[{ as = "1-3", unit = "1-2" }]') == [
        (
            "error: upstream[0].units[0].as: names 3 units for clients, but there are 2 behind the server"
            ' | as many as in unit = "1-2" are needed'
        )
    ]


def test_an_upstream_without_units():
    assert upstream("tcp://10.1.0.5", "[]") == [
        "error: upstream[0].units: is empty | write units = [{ as = 37, unit = 37 }]"
    ]


def test_a_server_has_an_address_and_a_port():
    assert upstream("tcp://0.0.0.0:502") == [
        "error: upstream[0].to: 0.0.0.0 is not the address of a server | name the server: its host name or address"
    ]
    assert upstream("tcp://10.1.0.5:0") == ["error: upstream[0].to: port 0 is not the port of a server"]
    line = '[[line]]\nport = "rtu+tcp://10.1.0.5:0"\n'
    assert problems(line) == ["error: line[0].port: port 0 is not the port of a server"]


@pytest.mark.parametrize(
    ("listen", "to"),
    [
        ("tcp://127.0.0.1:502", "tcp://127.0.0.1"),
        ("tcp://127.0.0.1:502", "tcp://localhost:502"),
        ("tcp://0.0.0.0:502", "tcp://127.0.0.1:502"),
        ("tcp://[::]:502", "tcp://[::1]"),
        ("tcp://[::]:502", "tcp://127.0.0.1:502"),
        ("tcp://10.1.0.5:502", "tcp://10.1.0.5"),
        ("tcp://plant.example:502", "tcp://PLANT.example"),
    ],
)
def test_a_gateway_that_would_ask_itself(listen, to):
    said = "error: upstream[0].to: leads back to this gateway (gateway.toml:1) | name another server"
    assert errors(to, listen=listen) == [said]


@pytest.mark.parametrize(
    ("listen", "to"),
    [
        ("tcp://127.0.0.1:502", "tcp://127.0.0.1:503"),
        ("tcp://127.0.0.1:502", "tcp://10.1.0.5:502"),
        ("tcp://0.0.0.0:502", "tcp://10.1.0.5:502"),
        ("tcp://[::]:502", "tcp://10.1.0.5:502"),
        ("tcp://[::]:502", "tcp://127.0.0.1:503"),
        ("tcp://127.0.0.1:0", "tcp://127.0.0.1:502"),
    ],
)
def test_a_gateway_that_asks_somebody_else_as_far_as_can_be_seen(listen, to):
    assert errors(to, listen=listen) == []


def test_the_listener_that_nobody_wrote_is_one_too():
    assert upstream("tcp://localhost:5020") == [
        "error: upstream[0].to: leads back to this gateway (the default listener) | name another server"
    ]


def test_a_line_that_leads_back_too():
    text = '[[listen]]\nbind = "tcp://127.0.0.1:4001"\n[[line]]\nport = "rtu+tcp://127.0.0.1:4001"\n'
    assert problems(text) == ["error: line[0].port: leads back to this gateway (gateway.toml:1) | name another server"]


def test_places_on_a_connection_are_bounded():
    text = '[[upstream]]\nto = "tcp://10.1.0.5"\nunits = [{ as = 1, unit = 1 }]\nin_flight = 65\n'
    assert problems(text) == ["error: upstream[0].in_flight: must be at most 64"]


@pytest.mark.parametrize("to", ["[]", '["tcp://10.1.0.5", "tcp://10.1.0.5:502"]', '["tcp://10.1.0.5", "fleet://east"]'])
def test_addresses_that_are_not_several_of_one_server(to):
    (said,) = problems(f"[[upstream]]\nto = {to}\nunits = [{{ unit = 7 }}]\n")
    assert said.startswith("error: upstream[0].to: ")


def test_each_of_several_addresses_is_looked_at():
    text = '[[upstream]]\nto = ["tcp://10.1.0.5", "tcp://10.1.0.6:0", "tcp://0.0.0.0"]\nunits = [{ unit = 7 }]\n'
    assert [said.split(" | ")[0] for said in problems(text)] == [
        "error: upstream[0].to[1]: port 0 is not the port of a server",
        "error: upstream[0].to[2]: 0.0.0.0 is not the address of a server",
    ]


@pytest.mark.parametrize("key", ['gap = "50 ms"', 'transaction_id = "zero"'])
def test_one_request_at_a_time(key):
    text = f'[[upstream]]\nto = "tcp://10.1.0.5"\nunits = [{{ unit = 7 }}]\n{key}\n'
    assert problems(text) == []
    assert problems(text + "in_flight = 1\n") == []
    (said,) = problems(text + "in_flight = 2\n")
    assert said.startswith(f"error: upstream[0].in_flight: {key.split()[0]} lets only one request at a time")


@pytest.mark.parametrize("key", ["gap", "after_connect", "idle"])
def test_another_site_has_no_connection(key):
    text = f'site = "west"\n[[upstream]]\nto = "fleet://east"\nunits = [{{ unit = 7 }}]\n{key} = "1 s"\n'
    fleet = '[fleet]\nservers = ["nats://127.0.0.1:4222"]\n'
    assert problems(text + fleet) == [
        f"error: upstream[0].{key}: is for connections, and a site has none | take it out"
    ]


@pytest.mark.parametrize(("keys", "is_told"), [("", False), ("in_flight = 1", True), ('gap = "50 ms"', True)])
def test_two_connections_to_a_server_that_gets_one_request_at_a_time(keys, is_told):
    one = '[[upstream]]\nname = "{}"\nto = "tcp://10.1.0.5"\nunits = [{{ unit = {} }}]\n'
    said = (
        'warning: upstream[1].to: tcp://10.1.0.5:502 is that of upstream "roof" too: one does not wait for the other'
        ' | move its units to "roof", so that the server gets one request at a time'
    )
    assert problems(f"{one.format('roof', 1)}{keys}\n{one.format('meter', 2)}") == [said] * is_told


@pytest.mark.parametrize(
    ("unit", "units"), [("0", "unit that clients use: as = 50"), ('"0-3"', "units that clients use")]
)
def test_unit_0_has_another_number_or_none_for_clients(unit, units):
    said = "error: upstream[0].units[0].unit: clients cannot ask for unit 0"
    none = 'or write as = "none": then only a [[listen]] with upstream leads to it, as unit 0'
    assert upstream("tcp://10.1.0.5", f"[{{ unit = {unit} }}]") == [f"{said} | name the {units}; {none}"]


def test_a_device_server_is_a_line_and_a_modbus_tcp_server_an_upstream():
    [said] = upstream("rtu+tcp://10.1.0.5:4001")
    assert said.endswith("it can be tcp://, tls://, fleet://; a device server belongs in [[line]], as `port`")
    [said] = problems('[[line]]\nport = "tcp://10.1.0.5:4001"\n')
    assert said.endswith("it can be rtu+tcp://, ascii+tcp://; a Modbus TCP server belongs in [[upstream]], as `to`")


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ('[[upstream]]\nto = "tcp://10.1.0.5"\ndevices = [{ unit = 1 }]', 'did you mean "units"?'),
        ('[[upstream]]\nto = "tcp://10.1.0.5"\nlatency = "1 s"', "it is a key of [[line]]"),
        (
            '[[upstream]]\nto = "tcp://10.1.0.5"\nunits = [{ unit = 1, limits = { 3 = 9 } }]',
            "it is a key of [profile.NAME]",
        ),
        ('[[line]]\nport = "/dev/a"\ntransaction_id = "zero"', "it is a key of [[upstream]]"),
        ('[[line]]\nto = "/dev/a"', 'did you mean "port"?'),
    ],
)
def test_a_key_of_another_table_is_said_to_be_one(text, remedy):
    assert [said.partition(" | ")[2] for said in problems(text) if "unknown key" in said] == [remedy]


def test_a_device_at_another_site_is_woken_there():
    text = 'site = "west"\n[[upstream]]\nto = "fleet://east"\nunits = [{ unit = 7, wake = "5 s" }]\nwake = "9 s"\n'
    said = "is for the gateway that asks the device itself | set it there"
    assert problems(text + '[fleet]\nservers = ["nats://127.0.0.1:4222"]\n') == [
        f"error: upstream[0].units[0].wake: {said}",
        f"error: upstream[0].wake: {said}",
    ]


def test_a_gap_that_nobody_waits_for():
    text = '[[upstream]]\nto = "tcp://10.1.0.5"\nunits = [{ unit = 7 }]\ngap = "3 s"\n'
    assert problems(text + 'max_wait = "4 s"\n') == []
    (said,) = problems(text)
    assert said.startswith("warning: upstream[0].gap: is longer than max_wait (2 s)")
