"""Units and their destinations."""

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from kit.config_problems import LINE, problems

MIRROR = '[[image]]\nunit = 241\nof = "one"\nread = [{ holding = "0-1", every = "500 ms" }]\n'


SERVER = '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\n'


def test_a_name_that_is_the_number_of_another_unit():
    """`write 102` would write unit 102."""
    text = '[[line]]\nport = "/dev/a"\ndevices = [{{ unit = 101, name = "{}" }}, {{ unit = 102 }}]\n'
    assert problems(text.format("101")) == problems(text.format("102a")) == []
    for name in ("102", "4711"):
        what = f'error: line[0].devices[0].name: "{name}" is a number, and means unit {name}; this is unit 101'
        assert problems(text.format(name)) == [f'{what} | add a letter, such as "unit-{name}"']


def test_an_image_whose_name_is_the_number_of_another_unit():
    text = '[[image]]\nunit = 200\nname = "{}"\nholding = 4\n'
    assert problems(text.format("200")) == []
    (said,) = problems(text.format("41"))
    assert said.startswith('error: image[0].name: "41" is a number, and means unit 41; this is unit 200')


def test_a_line_to_which_no_unit_is_left():
    text = '[[line]]\nname = "a"\nport = "/dev/a"\n[[upstream]]\nto = "tcp://b"\n'
    everything = text + 'units = [{ as = "1-247", unit = "1-247" }]\n'
    assert problems(everything) == ["error: line[0]: has no devices, and no unit is left to pass through | take it out"]
    assert problems(everything.replace("247", "246")) == []


def test_several_devices_cannot_have_one_name():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = "1-3", name = "x" }]\n'
    assert problems(text) == [
        (
            "error: line[0].devices[0].name: 3 devices cannot have one name"
            ' | write "x-*": * becomes the unit that clients use'
        )
    ]


def test_a_server_line_serves_units_that_somebody_answers_for():
    assert problems(LINE + SERVER + 'serves = ["1-3"]\n') == ["error: line[1].serves: units 2-3 are not configured"]


def test_a_server_line_serves_units_by_their_numbers_for_clients():
    line = LINE.replace("unit = 1,", 'unit = "1-2", as = "41-42",').replace('name = "one"', 'profile = "generic"')
    remedy = "use the unit IDs for clients: 41 is at address 1, 42 is at address 2"
    unknown = f"units 1-2 are not configured | {remedy}"
    assert problems(line + SERVER + "serves = [1, 2]\n") == [f"error: line[1].serves: {unknown}"]


def test_a_server_line_stands_beside_a_line_that_passes_through():
    assert problems('[[line]]\nport = "/dev/a"\n' + SERVER + 'serves = "1-247"\n') == []


def test_a_server_line_cannot_serve_a_device_of_its_own_port():
    """It would ask itself: one port is on one line only."""
    text = LINE + SERVER.replace("/dev/p", "/dev/a") + "serves = 1\n"
    assert problems(text) == ["error: line[1].port: this port is already used in gateway.toml:1"]


def test_a_line_without_devices_must_be_alone():
    assert problems(LINE + '[[line]]\nname = "b"\nport = "/dev/b"\n') == [
        (
            "error: line[1]: has no devices, but is not the only client line: it is unknown which units are on it"
            " | name its devices, such as devices = [{ unit = 1 }], or give it its own [[listen]]"
            ' with line = "b"'
        )
    ]


def test_an_empty_list_of_devices_is_no_passing_through():
    assert problems('[[line]]\nport = "/dev/a"\ndevices = []\n') == [
        "error: line[0].devices: is empty | leave it out, and every unit 1-247 passes through"
    ]


def test_a_unit_that_clients_use_leads_to_one_device():
    text = LINE + '[[line]]\nname = "b"\nport = "/dev/b"\ndevices = [{ unit = "1-3" }, { unit = 9, as = 3 }]\n'
    assert problems(text) == [
        (
            'error: line[1].devices[0].unit: 1 is already a unit of line "a" (gateway.toml:4)'
            ' | give one of them another unit ID for clients with "as"'
            ', or as = "none" and the line a listener of its own: [[listen]] with line = "b"'
        ),
        (
            'error: line[1].devices[1].as: 3 is already a unit of line "b" (gateway.toml:8)'
            ' | give one of them another unit ID for clients with "as"'
        ),
    ]


def test_an_image_has_a_unit_of_its_own():
    assert problems(LINE + "[[image]]\nunit = 1\ncoils = 1\n") == [
        'error: image[0].unit: 1 is already a unit of line "a" (gateway.toml:4)'
    ]


def test_an_upstream_has_units_of_its_own():
    text = "[[image]]\nunit = 1\ncoils = 1\n[[image]]\nunit = 2\ncoils = 1\n"
    text += '[[upstream]]\nto = "tcp://10.0.0.1"\nunits = [{ as = "1-2", unit = "1-2" }]\n'
    owner = 'upstream "tcp://10.0.0.1:502" (gateway.toml:9)'
    assert problems(text) == [
        f"error: image[0].unit: 1 is already a unit of {owner}",
        f"error: image[1].unit: 2 is already a unit of {owner}",
    ]


def test_several_units_of_one_owner_are_told_at_once():
    text = LINE.replace("unit = 1", 'unit = "1-9"').replace("one", "*") + '[[line]]\nname = "b"\nport = "/dev/b"\n'
    assert problems(text + 'devices = [{ unit = "8-12" }]\n') == [
        (
            'error: line[1].devices[0].unit: 8-9 are already units of line "a" (gateway.toml:4)'
            ' | give one of them another unit ID for clients with "as"'
            ', or as = "none" and the line a listener of its own: [[listen]] with line = "b"'
        )
    ]


def test_an_image_takes_its_unit_from_a_line_that_passes_through():
    assert problems('[[line]]\nport = "/dev/a"\n[[image]]\nunit = 200\ncoils = 1\n') == []


def test_as_names_as_many_units_as_there_are_on_the_wire():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = "10-13", as = "110-112" }]\n'
    assert problems(text) == [
        (
            "error: line[0].devices[0].as: names 3 units for clients, but there are 4 on the wire"
            ' | as many as in unit = "10-13" are needed'
        )
    ]


def test_a_device_that_clients_know_twice_is_a_warning():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = 1, as = 41 },\n { unit = 1, as = 42 }]\n'
    assert problems(text) == [
        "warning: line[0].devices[1].unit: unit 1 on the wire already has the unit ID 41 for clients"
    ]


def test_unit_0_on_the_wire_wants_to_be_alone():
    alone = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = 0, as = 50 }]\n'
    assert problems(alone) == []
    (problem,) = problems(alone.replace("}]", "}, { unit = 1 }]"))
    assert problem.startswith("warning: line[0].devices[0].unit: any device on the line may answer unit 0")
    assert problem.endswith("| it must be the only device of its line")


def test_unit_0_needs_a_unit_for_clients():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = 0 }]\n'
    assert problems(text) == [
        "error: line[0].devices[0].unit: unit 0 stands for every device | name the unit that clients use: as = 50"
    ]


def test_unit0_names_a_unit_that_somebody_answers_for():
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:1"\nunit0 = {}\n'
    assert problems(LINE + listen.format(99)) == ["error: listen[0].unit0: unit 99 is not configured"]
    assert problems(LINE + listen.format(1)) == []
    assert problems('[[line]]\nport = "/dev/a"\n' + listen.format(99)) == []


def test_addresses_that_the_specification_reserves_are_noted():
    assert problems(LINE.replace("unit = 1", 'unit = "247-250"').replace('name = "one"', 'name = "one-*"')) == [
        (
            "warning: line[0].devices[0].unit: unit 248-250: the specification reserves 248-255"
            " | right if the device is set to it; others are 1-247"
        )
    ]
    assert problems(LINE.replace("unit = 1", "unit = 1, as = 250")) == []


def test_a_lone_device_can_be_polled_with_function_3_only():
    text = LINE.replace("unit = 1", "unit = 0, as = 1") + MIRROR
    assert problems(text) == []
    assert problems(text.replace("holding", "input")) == [
        "error: image[0].read[0].input: one has no function 4, which reads input"
    ]


def test_the_unit_of_the_gateway_is_nobody_elses():
    text = LINE + "[self]\nunit = 1\n"
    assert problems(text) == ['error: self.unit: 1 is already a unit of line "a" (gateway.toml:4)']


def test_the_unit_of_the_gateway_does_not_pass_through():
    config = parse('[[line]]\nport = "/dev/a"\n[self]\nunit = 246\n', port_trouble=lambda _: None).config
    plan = resolve(config)
    assert 246 not in {device.known_as for device in plan.lines[0].devices}
    assert [image.unit for image in plan.images] == [246]


def test_a_server_line_may_serve_the_gateway():
    server = '[[line]]\nname = "panel"\nport = "/dev/b"\nrole = "server"\nserves = [246]\n'
    assert problems(LINE + server + "[self]\nunit = 246\n") == []


OWN = """
[[listen]]
bind = "tcp://127.0.0.1:502"

[[listen]]
bind = "tcp://127.0.0.1:503"
line = "b"
"""
TWO = LINE.replace("unit = 1", 'unit = "1-9"').replace("one", "a-*") + (
    '[[line]]\nname = "b"\nport = "/dev/b"\ndevices = [{ unit = "1-2" }, { unit = 3 }, { unit = "4-5" }]\n'
)


def test_a_line_with_its_own_listener_is_told_that_its_devices_need_no_units():
    """All that two lines have in common is one error: the file of five lines with 240 devices each had 960."""
    assert problems(OWN + TWO) == [
        (
            'error: line[1].devices[0].unit: 1-5 are already units of line "a" (gateway.toml:11)'
            ' | give one of them another unit ID for clients with "as", or as = "none": the listener for the line leads'
            " to it, and its name"
        )
    ]
    without = [f'{{ unit = {units}, as = "none" }}' for units in ('"1-2"', 3, '"4-5"')]
    assert problems(f"{OWN}{TWO.rpartition('devices')[0]}devices = [{', '.join(without)}]\n") == []


def test_devices_without_units_need_no_listener():
    """They may be published, mirrored, or asked by name."""
    text = '[[line]]\nname = "{0}"\nport = "/dev/{0}"\ndevices = [{{ unit = "1-247", as = "none" }}]\n'
    assert problems("".join(text.format(name) for name in "abcd")) == []


def test_the_name_of_a_device_without_a_unit_is_no_number():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{{ unit = 5, as = "none", name = "{}" }}]\n'
    assert problems(text.format("five")) == []
    assert problems(text.format("5")) == [
        (
            'error: line[0].devices[0].name: "5" is a number, and means unit 5; this device has none'
            ' | add a letter, such as "unit-5"'
        )
    ]


def test_one_address_with_two_names():
    text = '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = "1-2", as = "none" }, { unit = 2, as = 7 }]\n'
    assert problems(text) == ["warning: line[0].devices[1].unit: unit 2 on the wire already is a/2"]


def test_names_of_devices_without_units_have_the_unit_on_the_wire():
    text = '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = "1-2", as = "none" }]\n'
    config = parse(text + '[[line]]\nport = "/dev/b"\ndevices = [{ unit = "7-8", as = "none", name = "x-*" }]\n').config
    assert config is not None
    devices = [device for line in resolve(config).lines for device in line.devices]
    assert [(each.name, each.unit, each.client_unit) for each in devices] == [
        ("a/1", 1, None),
        ("a/2", 2, None),
        ("x-7", 7, None),
        ("x-8", 8, None),
    ]


def test_a_row_without_units_has_names_of_its_own():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = "1-3", as = "none", name = "x" }]\n'
    assert problems(text) == [
        'error: line[0].devices[0].name: 3 devices cannot have one name | write "x-*": * becomes the unit on the wire'
    ]


def test_a_lone_device_without_an_address_needs_no_unit_either():
    assert problems('[[line]]\nport = "/dev/a"\ndevices = [{ unit = 0, as = "none", name = "x" }]\n') == []


TWO_PORTS = """\
[[listen]]
bind = "tcp://127.0.0.1:1502"
line = "a"
[[listen]]
bind = "tcp://127.0.0.1:1503"
upstream = "b"
[[line]]
name = "a"
port = "/dev/a"
devices = [{ unit = "1-9" }, { unit = 20 }]
[[upstream]]
name = "b"
to = "tcp://10.1.0.5"
units = [{ unit = "8-12" }]
"""


def test_without_a_general_listener_units_of_several_devices_belong_to_none():
    assert problems(TWO_PORTS) == []
    plan = resolve(parse(TWO_PORTS, port_trouble=lambda _: None).config)
    (line,), (upstream,) = plan.lines, plan.upstreams
    assert [device.client_unit for device in line.devices] == [None] * 9 + [20]
    assert {device.client_unit for device in upstream.devices} == {None}
    assert {device.unit for device in upstream.devices} == {8, 9, 10, 11, 12}


@pytest.mark.parametrize(
    "asks_by_units",
    [
        '[[listen]]\nbind = "tcp://127.0.0.1:1504"\n',
        '[[line]]\nport = "/dev/c"\nrole = "server"\nserves = [20]\n',
        'site = "x"\n[fleet]\nservers = ["nats://127.0.0.1:4222"]\n',
    ],
)
def test_where_somebody_asks_by_units_each_has_one_device(asks_by_units):
    first, _, rest = asks_by_units.partition("\n")
    text = first + "\n" + TWO_PORTS + rest if first.startswith("site") else TWO_PORTS + asks_by_units
    found = [said for said in problems(text) if said.startswith("error")]
    assert [said.split(" (")[0] for said in found] == [
        'error: upstream[0].units[0].unit: 8-9 are already units of line "a"'
    ]
    assert "as = " in found[0]


@pytest.mark.parametrize(
    ("row", "are_shared"),
    [
        ('units = 8\nallow = ["read"]\n', False),
        ('units = 8\nlisten = ["control"]\nallow = ["read"]\n', False),
        ('units = 7\nallow = ["read"]\n', True),
        ('allow = ["read"]\n', True),
        ('units = 8\nlisten = ["tcp://127.0.0.1:1502"]\nallow = ["read"]\n', True),
    ],
)
def test_a_unit_that_a_row_of_rights_means_is_that_of_one_device(row, are_shared):
    """A second line must not be enough to have a row forgotten that keeps clients from writing."""
    found = [said for said in problems(TWO_PORTS + "[[access]]\n" + row) if said.startswith("error")]
    assert bool(found) is not are_shared
    assert all("already units of line" in said for said in found)


def test_a_unit_that_is_written_stays():
    text = TWO_PORTS.replace('{ unit = "8-12" }', '{ unit = "8-12", as = "8-12" }')
    plan = resolve(parse(text, port_trouble=lambda _: None).config)
    assert [device.client_unit for device in plan.upstreams[0].devices] == [8, 9, 10, 11, 12]
    assert {device.client_unit for device in plan.lines[0].devices} == {None, 20}
