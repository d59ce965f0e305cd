"""What must fit together: each rule with a file that breaks it."""

from textwrap import dedent

import pytest

from gateway.config.check import check
from gateway.config.load import parse
from gateway.config.problem import dotted
from gateway.config.resolve import resolve

LINE = '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = 1, name = "one" }]\n'


def problems(text, port_trouble=lambda _: None, real_path=str):
    """What is said about `text`, without its place in the file."""
    found = parse(dedent(text), "gateway.toml", port_trouble, real_path).problems
    return [
        f"{one.severity}: {dotted(one.path)}: {one.what}" + (f" | {one.remedy}" if one.remedy else "") for one in found
    ]


def test_an_empty_file_serves_nothing():
    said = 'error: : there is no [[line]], and nothing else to serve | add [[line]] with port = "/dev/ttyUSB0"'
    assert problems("") == [said]


def test_an_image_alone_is_something_to_serve():
    assert problems("[[image]]\nunit = 200\nholding = 10\n") == []


def test_the_checks_can_be_had_for_a_config_without_any_file():
    config = parse(LINE).config
    assert config is not None
    assert list(check(config)) == []


# Names


def test_two_listeners_with_one_name():
    text = (
        LINE
        + '[[listen]]\nname = "x"\nbind = "tcp://127.0.0.1:1"\n[[listen]]\nname = "x"\nbind = "tcp://127.0.0.1:2"\n'
    )
    assert problems(text) == ['error: listen[1].name: "x" is already used in gateway.toml:5']


def test_two_lines_with_one_name():
    text = LINE + '[[line]]\nname = "a"\nport = "/dev/b"\ndevices = [{ unit = 2 }]\n'
    assert problems(text) == ['error: line[1].name: "a" is already used in gateway.toml:1']


def test_two_lines_that_are_called_after_ports_of_one_name():
    text = (
        '[[line]]\nport = "/dev/x/a"\ndevices = [{ unit = 1 }]\n[[line]]\nport = "/dev/y/a"\ndevices = [{ unit = 2 }]\n'
    )
    assert 'error: line[1].name: "a" is already used in gateway.toml:1' in problems(text)


def test_two_devices_with_one_name():
    text = LINE.replace("}]", '},\n  { unit = 2, name = "one" }]')
    assert problems(text) == [
        'error: line[0].devices[1].name: "one" is already used in gateway.toml:4, line[0].devices[0]'
    ]


def test_a_device_that_is_called_as_one_without_a_name():
    """A mirror of a/2 would ask the wrong unit."""
    text = LINE.replace("}]", '},\n  { unit = 2 }, { unit = 3, name = "a/2" }]')
    assert problems(text) == [
        'error: line[0].devices[2].name: "a/2" is already used in gateway.toml:5, line[0].devices[1]'
    ]


def test_a_device_that_is_called_as_a_unit_behind_another_server():
    text = LINE.replace('"one"', '"u/7"') + (
        '[[upstream]]\nname = "u"\nto = "tcp://10.0.0.1"\nunits = [{ as = 7, unit = 1 }]\n'
    )
    assert problems(text) == ['error: line[0].devices[0].name: "u/7" is already used in gateway.toml:8']


def test_units_that_are_there_twice_are_not_blamed_for_their_names_too():
    text = LINE.replace('unit = 1, name = "one"', "unit = 1 }, { unit = 1")
    (said,) = problems(text)
    assert said.startswith('error: line[0].devices[1].unit: 1 is already a unit of line "a"')


def test_two_images_with_one_name():
    text = '[[image]]\nunit = 1\ncoils = 1\nname = "x"\n[[image]]\nunit = 2\ncoils = 1\nname = "x"\n'
    assert problems(text) == ['error: image[1].name: "x" is already used in gateway.toml:1']


def test_an_image_with_the_name_of_a_device():
    """A broker would get the values of the one as those of the other, and write to it."""
    text = LINE + '[[image]]\nunit = 200\nname = "one"\nholding = 4\n'
    said = 'error: image[0].name: "one" is already used in gateway.toml:4, line[0].devices[0]'
    assert problems(text) == [said]
    assert problems(text.replace("holding = 4", 'of = "one"\nread = [{ holding = "0-9", every = "1 s" }]')) == [said]


def test_an_image_with_the_name_of_a_unit_that_nobody_has_named():
    for line in ('name = "a"\nport = "/dev/a"\n', 'name = "a"\nport = "/dev/a"\ndevices = [{ unit = 2 }]\n'):
        text = f'[[line]]\n{line}[[image]]\nunit = 200\nname = "a/2"\nholding = 4\n'
        (said,) = problems(text)
        assert said.startswith('error: image[0].name: "a/2" is already used in gateway.toml:')


def test_an_image_with_the_name_of_the_gateway_itself():
    """At a reload the one was looked for where the other was."""
    image = '[[image]]\nunit = 200\nname = "gateway"\nholding = 4\n'
    assert problems(image) == []
    assert problems(image + "[self]\nunit = 246\n") == [
        'error: image[0].name: "gateway" is already used in gateway.toml:5'
    ]


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


def test_two_upstreams_with_one_name():
    one = '[[upstream]]\nname = "x"\nto = "tcp://10.0.0.1"\nunits = [{{ as = {0}, unit = 1 }}]\n'
    assert problems(one.format(1) + one.format(2)) == ['error: upstream[1].name: "x" is already used in gateway.toml:1']


def test_a_line_and_an_upstream_with_one_name():
    text = LINE + '[[upstream]]\nname = "a"\nto = "tcp://10.0.0.1"\nunits = [{ as = 2, unit = 2 }]\n'
    assert problems(text) == ['error: upstream[0].name: "a" is already used in gateway.toml:1']


def test_a_line_to_which_no_unit_is_left():
    text = '[[line]]\nname = "a"\nport = "/dev/a"\n[[upstream]]\nto = "tcp://b"\n'
    everything = text + 'units = [{ as = "1-247", unit = "1-247" }]\n'
    assert problems(everything) == ["error: line[0]: has no devices, and no unit is left to pass through | take it out"]
    assert problems(everything.replace("247", "246")) == []


def test_a_control_socket_whose_path_is_too_long():
    control = f'[control]\nsocket = "/run/{"x" * 102}"\n'
    assert problems(LINE + control) == []
    assert problems(LINE + control.replace("/run/", "/run/x")) == ["error: control.socket: is longer than 107 bytes"]


def test_a_control_socket_whose_path_no_system_takes():
    control = '[control]\nsocket = "/tmp/\\u0000x"\n'
    assert problems(LINE + control) == ["error: control.socket: has characters that cannot be seen"]


def test_the_name_of_the_control_socket_is_taken():
    text = LINE + '[[listen]]\nname = "control"\nbind = "tcp://127.0.0.1:1"\n'
    assert problems(text) == ['error: listen[0].name: "control" is what [[access]] calls the control socket']


def test_several_devices_cannot_have_one_name():
    text = '[[line]]\nport = "/dev/a"\ndevices = [{ unit = "1-3", name = "x" }]\n'
    assert problems(text) == [
        (
            "error: line[0].devices[0].name: 3 devices cannot have one name"
            ' | write "x-*": * becomes the unit that clients use'
        )
    ]


# Listeners


def test_two_listeners_at_one_address():
    text = (
        LINE
        + '[[listen]]\nname = "x"\nbind = "tcp://127.0.0.1:1"\n[[listen]]\nname = "y"\nbind = "tcp://127.0.0.1:1"\n'
    )
    assert problems(text) == ["error: listen[1].bind: this address is already used in gateway.toml:5"]


def test_two_listeners_may_both_take_a_free_port():
    text = (
        LINE
        + '[[listen]]\nname = "x"\nbind = "tcp://127.0.0.1:0"\n[[listen]]\nname = "y"\nbind = "tcp://127.0.0.1:0"\n'
    )
    assert problems(text) == []


@pytest.mark.parametrize(
    ("one", "other"),
    [("0.0.0.0", "127.0.0.1"), ("127.0.0.1", "0.0.0.0"), ("[::]", "[::1]"), ("0.0.0.0", "localhost"), ("a.b", "A.B")],
)
def test_a_wildcard_takes_the_port_from_every_address(one, other):
    text = LINE + f'[[listen]]\nbind = "tcp://{one}:1"\n[[listen]]\nbind = "tcp://{other}:1"\n'
    (said,) = [said for said in problems(text) if said.startswith("error")]
    assert said.startswith("error: listen[1].bind: this address is already used in gateway.toml:5")
    wildcard = next((host.strip("[]") for host in (one, other) if host in ("0.0.0.0", "[::]")), None)
    assert wildcard is None or said.endswith(f"; {wildcard} stands for every address of its kind")


@pytest.mark.parametrize("other", ["localhost", "127.0.0.1", "[::1]", "0.0.0.0", "[::]"])
@pytest.mark.parametrize("bind", ["tcp://{}:1", "http://{}:1"])
def test_localhost_is_an_address_of_both_kinds(bind, other):
    own = "[[listen]]" if bind.startswith("tcp") else '[web]\ntoken = { file = "/dev/null" }'
    text = LINE + f'[[listen]]\nbind = "tcp://localhost:1"\n{own}\nbind = "{bind.format(other)}"\n'
    (said,) = [said for said in problems(text) if said.startswith("error")]
    assert "bind: this address is already used in gateway.toml:5" in said
    if other in ("127.0.0.1", "[::1]"):
        assert said.endswith("; localhost stands for 127.0.0.1 and [::1]")


@pytest.mark.parametrize(("one", "other"), [("0.0.0.0", "[::]"), ("[::]", "127.0.0.1"), ("127.0.0.1", "10.0.0.1")])
def test_ipv4_and_ipv6_have_ports_of_their_own(one, other):
    text = LINE + f'[[listen]]\nbind = "tcp://{one}:1"\n[[listen]]\nbind = "tcp://{other}:1"\n'
    assert [said for said in problems(text) if said.startswith("error")] == []


def test_an_ipv4_address_that_is_written_as_an_ipv6_one_is_the_same_address():
    text = LINE + "".join(f'[[listen]]\nbind = "tcp://{host}:1"\n' for host in ("127.0.0.1", "[::ffff:127.0.0.1]"))
    assert problems(text) == ["error: listen[1].bind: this address is already used in gateway.toml:5"]


def test_who_has_no_name_is_not_blamed_for_being_called_after_a_place_that_is_taken():
    line = '[[line]]\nport = "/dev/a"\ndevices = [{{ unit = {} }}]\n'
    assert problems(line.format(1) + line.format(2)) == [
        "error: line[1].port: this port is already used in gateway.toml:1"
    ]
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:1"\n'
    assert problems(LINE + listen + listen) == ["error: listen[1].bind: this address is already used in gateway.toml:5"]


BOTH = '[[listen]]\nname = "x"\nbind = "{}://127.0.0.1:1"\n[[listen]]\nname = "y"\nbind = "{}://127.0.0.1:1"\n'


def test_udp_and_tcp_ports_are_not_the_same():
    assert [said for said in problems(LINE + BOTH.format("tcp", "udp")) if said.startswith("error")] == []


def test_everything_on_tcp_has_the_same_ports():
    taken = ["error: listen[1].bind: this address is already used in gateway.toml:5"]
    assert problems(LINE + BOTH.format("tcp", "rtu+tcp")) == taken
    assert problems(LINE + BOTH.format("ascii+tcp", "rtu+tcp")) == taken


@pytest.mark.parametrize("ipv4", ["127.0.0.1", "localhost"])
def test_an_ipv4_listener_leaves_the_wildcard_of_ipv6_no_ipv4_clients(ipv4):
    text = LINE + f'[[listen]]\nbind = "tcp://[::]:1"\n[[listen]]\nbind = "tcp://{ipv4}:1"\n'
    said = "takes IPv6 clients only, because gateway.toml:7 has an IPv4 address with the same port"
    remedy = 'to serve every IPv4 address, write "tcp://0.0.0.0:1" in gateway.toml:7'
    assert problems(text)[0] == f"warning: listen[0].bind: {said} | {remedy}"
    for other in ("udp://127.0.0.1:1", "tcp://127.0.0.1:2", "tcp://0.0.0.0:1", "tcp://[::1]:2", "tcp://a.b:1"):
        text = LINE + f'[[listen]]\nbind = "tcp://[::]:1"\n[[listen]]\nbind = "{other}"\n'
        assert not [one for one in problems(text) if said[:22] in one]


@pytest.mark.parametrize(
    ("one", "other", "is_told"),
    [
        ("tcp://0.0.0.0:502", "tcp://[::]:502", True),
        ("tcp://[::]:502", "rtu+tcp://10.2.0.1:502", True),
        ("tcp://10.2.0.1:502", "tcp://10.3.0.1:502", True),
        ("udp://10.2.0.1:502", "udp://[::1]:502", True),
        ("tcp://10.2.0.1:502", "udp://10.3.0.1:502", False),
        ("tcp://10.2.0.1:502", "tcp://10.3.0.1:503", False),
        ("tcp://0.0.0.0:1024", "tcp://[::]:1024", False),
        ("tcp://0.0.0.0:502", "tcp://10.2.0.1:502", False),  # an error
    ],
)
def test_a_port_of_the_socket_unit_is_not_shared_unless_that_says_so(one, other, is_told):
    text = LINE + f'[[listen]]\nbind = "{one}"\n[[listen]]\nbind = "{other}"\n'
    told = (
        "warning: listen[1].bind: the service does not start with it and gateway.toml:5, unless modbus-gateway.socket "
        'names both | its [::] takes clients of every address; for both see "Other addresses" in docs/operations.md'
    )
    assert [said for said in problems(text) if "does not start" in said] == [told] * is_told


# Ports


def test_one_port_on_two_lines():
    text = LINE + '[[line]]\nname = "b"\nport = "/dev/a"\ndevices = [{ unit = 2 }]\n'
    assert problems(text) == ["error: line[1].port: this port is already used in gateway.toml:1"]


def test_one_port_under_two_names():
    text = LINE + '[[line]]\nname = "b"\nport = "/dev/by-id/a"\ndevices = [{ unit = 2 }]\n'
    said = ["error: line[1].port: this port is already used in gateway.toml:1"]
    assert problems(text, real_path=lambda path: path.replace("/by-id", "")) == said
    assert problems(text) == []


def test_one_device_server_on_two_lines():
    line = '[[line]]\nname = "{0}"\nport = "rtu+tcp://10.0.0.1:4001"\ndevices = [{{ unit = {0} }}]\n'
    said = ["error: line[1].port: this port is already used in gateway.toml:1"]
    assert problems(line.format(1) + line.format(2), port_trouble=lambda _: "is absent") == said


def test_one_device_server_under_two_schemes():
    text = LINE.replace("/dev/a", "rtu+tcp://Server:4001")
    text += '[[line]]\nname = "b"\nport = "ascii+tcp://server:4001"\ndevices = [{ unit = 2 }]\n'
    assert problems(text) == ["error: line[1].port: this port is already used in gateway.toml:1"]


def test_a_device_server_whose_scheme_is_another_mode():
    text = LINE.replace('"/dev/a"', '"rtu+tcp://10.0.0.1:4001"\nmode = "ascii"')
    assert problems(text) == [
        ('error: line[0].mode: rtu+tcp:// carries RTU | leave mode out, or write port = "ascii+tcp://10.0.0.1:4001"')
    ]
    assert problems(text.replace('"ascii"', '"rtu"')) == []


def test_a_device_server_with_seven_bits():
    text = LINE.replace('"/dev/a"', '"rtu+tcp://10.0.0.1:4001"\nformat = "7E1"')
    assert problems(text) == ['error: line[0].format: RTU needs 8 data bits | write "8E1", or ascii+tcp:// in port']
    assert problems(text.replace("rtu+", "ascii+")) == []


def test_a_device_server_has_no_kernel_driver_here():
    text = LINE.replace('"/dev/a"', '"rtu+tcp://10.0.0.1:4001"\nrs485 = "kernel"')
    assert problems(text) == [
        (
            "error: line[0].rs485: a device server controls its own driver"
            ' | set RS-485 in the device server, and leave rs485 out or "adapter"'
        )
    ]


def test_a_port_that_cannot_be_used_is_a_warning():
    trouble = {"/dev/a": "is not a serial port"}
    assert problems(LINE, port_trouble=trouble.get) == [
        (
            "warning: line[0].port: is not a serial port"
            " | the line waits for it; modbus-gateway ports lists those that exist"
        )
    ]
    assert problems(LINE.replace("/dev/a", "/dev/b"), port_trouble=trouble.get) == []


# Lines


@pytest.mark.parametrize(
    ("mode", "character_format", "said"),
    [
        ("rtu", "7E1", ['error: line[0].format: RTU needs 8 data bits | write "8E1", or mode = "ascii"']),
        ("rtu", "8N2", []),
        (
            "ascii",
            "8E1",
            ['warning: line[0].format: 8E1 is unusual for ASCII devices | most are set to "7E1", "7O1" or "8N1"'],
        ),
        ("ascii", "8N1", []),
        ("ascii", "7O1", []),
    ],
)
def test_the_format_fits_the_mode(mode, character_format, said):
    assert problems(LINE + f'mode = "{mode}"\nformat = "{character_format}"\n') == said


def test_a_client_line_has_no_keys_of_a_server_line():
    assert problems(LINE + 'serves = 1\nanswer_within = "1 s"\n') == [
        'error: line[0].serves: only a line with role = "server" has this key',
        'error: line[0].answer_within: only a line with role = "server" has this key',
    ]


SERVER = '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\n'


def test_a_server_line_has_no_keys_of_a_client_line():
    text = LINE + SERVER + "serves = 1\nretries = 1\ndevices = [{ unit = 5 }]\n"
    assert problems(text) == [
        'error: line[1].retries: only a line with role = "client" has this key',
        'error: line[1].devices: only a line with role = "client" has this key',
    ]


def test_a_server_line_serves_something():
    assert problems(LINE + SERVER) == [
        "error: line[1].serves: serves is missing | name the units that the gateway answers for: serves = [41]"
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


def test_two_server_lines_with_one_name_are_told_once():
    text = LINE + SERVER + "serves = 1\n" + SERVER.replace("/dev/p", "/dev/q") + "serves = 1\n"
    assert problems(text) == ['error: line[2].name: "panel" is already used in gateway.toml:5']


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


# Units


def test_a_unit_that_clients_use_leads_to_one_device():
    text = LINE + '[[line]]\nname = "b"\nport = "/dev/b"\ndevices = [{ unit = "1-3" }, { unit = 9, as = 3 }]\n'
    assert problems(text) == [
        (
            'error: line[1].devices[0].unit: 1 is already a unit of line "a" (gateway.toml:4)'
            ' | give one of them another unit ID for clients with "as"'
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
    assert problems(text) == [
        'error: upstream[0].units[0].as: 1 is already a unit of image "image-1" (gateway.toml:1)',
        'error: upstream[0].units[0].as: 2 is already a unit of image "image-2" (gateway.toml:4)',
    ]


def test_several_units_of_one_owner_are_told_at_once():
    text = LINE.replace("unit = 1", 'unit = "1-9"').replace("one", "*") + '[[line]]\nname = "b"\nport = "/dev/b"\n'
    assert problems(text + 'devices = [{ unit = "8-12" }]\n') == [
        (
            'error: line[1].devices[0].unit: 8-9 are already units of line "a" (gateway.toml:4)'
            ' | give one of them another unit ID for clients with "as"'
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


# Profiles


@pytest.mark.parametrize(
    ("text", "path"),
    [
        (LINE + 'profile = "wiegher"\n', "line[0]"),
        (LINE.replace('name = "one"', 'profile = "wiegher"'), "line[0].devices[0]"),
        ('[[image]]\nunit = 1\ncoils = 1\nprofile = "wiegher"\n', "image[0]"),
    ],
)
def test_a_profile_that_does_not_exist(text, path):
    assert problems(text) == [f'error: {path}.profile: there is no profile "wiegher" | did you mean "weigher"?']


def test_a_profile_without_any_function_is_none():
    assert problems(LINE + "[profile.x]\nfunctions = []\n") == [
        "error: profile.x.functions: is empty | leave it out, and every function is accepted"
    ]


def test_more_items_cannot_take_less_time():
    text = LINE + '[profile.x]\ntiming = [{ fc = 3, items = 9, time = "5 ms" }, { fc = 3, items = 1, time = "9 ms" }]\n'
    assert problems(text) == [
        (
            "error: profile.x.timing[0].time: function 3 takes less time for 9 items than for 1"
            " | more items cannot take less time"
        )
    ]


def test_a_function_has_one_time_for_so_many_items():
    text = LINE + '[profile.x]\ntiming = [{ fc = 3, items = 1, time = "5 ms" }, { fc = 3, items = 1, time = "5 ms" }]\n'
    assert problems(text) == ["error: profile.x.timing[1].items: function 3 already has a time for 1 items"]


def test_times_of_different_functions_have_nothing_to_do_with_each_other():
    text = LINE + '[profile.x]\ntiming = [{ fc = 3, items = 1, time = "9 ms" }, { fc = 4, items = 2, time = "5 ms" }]\n'
    assert problems(text) == []


# Images and mirrors


def test_an_image_has_something():
    assert problems("[[image]]\nunit = 1\n") == [
        "error: image[0]: has no register and no coil | write how many, such as holding = 100"
    ]


@pytest.mark.parametrize(
    ("initial", "said"),
    [
        ("initial.holding = [{ at = 8, values = [1, 2] }]", []),
        (
            "initial.holding = [{ at = 9, values = [1, 2] }]",
            ["error: image[0].initial.holding[0]: holding 9-10 do not all exist in this image | its holding: 0-9"],
        ),
        (
            "initial.input = [{ at = 0, values = [1] }]",
            ["error: image[0].initial.input[0]: input 0 do not all exist in this image | its input: none"],
        ),
        ("initial.coils = [{ at = 0, values = [1, false] }]", []),
        (
            "initial.coils = [{ at = 0, values = [] }]",
            ["error: image[0].initial.coils[0].values: is empty"],
        ),
        (
            "initial.coils = [{ at = 0, values = [2] }]",
            ["error: image[0].initial.coils[0].values: coils can only be 0 or 1"],
        ),
    ],
)
def test_first_values_have_their_place_in_the_image(initial, said):
    assert problems(f"[[image]]\nunit = 1\nholding = 10\ncoils = 4\n{initial}\n") == said


def told(area, base, first, meant, others=""):
    """What is said of an address that may be the reference number of a manual, or not."""
    return (
        f"if {first} is a number of a manual that counts from {base}, write {area} = {meant}{others}; if the device "
        f'has this address, as with SunSpec and SMA, {area} = "{base - 1}-{base + 9998}" in its profile says so'
    )


@pytest.mark.parametrize(
    ("area", "written", "meant"),
    [
        ("holding", "40001-40100", told("holding", 40001, 40001, '"0-99"')),
        ("input", "30011", told("input", 30001, 30011, '"10-10"')),
        ("discrete", "10001-10016", told("discrete", 10001, 10001, '"0-15"')),
    ],
)
def test_the_numbers_of_a_manual_are_not_the_addresses_on_the_wire(area, written, meant):
    said = f"warning: {{}}.{area}: addresses are those on the wire, from 0 | {meant}"
    assert problems(f'[[image]]\nunit = 1\n{area} = "{written}"\n') == [said.format("image[0]")]
    assert problems(LINE + f'[profile.x]\n{area} = "{written}"\n') == [said.format("profile.x")]


def test_points_with_the_numbers_of_a_manual_are_told_once_for_each_table():
    points = 'points = [{ name = "a", holding = 40011 }, { name = "b", input = 30002 }, { name = "c", holding = 7 }]\n'
    what = "addresses are those on the wire, from 0"
    meant, others = told("holding", 40001, 40011, 10), told("holding", 40001, 40011, 10, "; likewise 1 more point")
    assert problems(LINE + f"[profile.x]\n{points}") == [f"warning: profile.x.points[0].holding: {what} | {others}"]
    device = (
        '[[line]]\nname = "l"\nport = "/dev/l"\ndevices = [{ unit = 1, points = [{ name = "a", holding = 40011 }] }]\n'
    )
    assert problems(device) == [f"warning: line[0].devices[0].points[0].holding: {what} | {meant}"]


@pytest.mark.parametrize("area", ['holding = "0-65535"', 'holding = "40001-60000"', 'coils = "1-16"', "holding = 0"])
def test_other_addresses_may_be_meant(area):
    assert problems(f"[[image]]\nunit = 1\ninput = 1\n{area}\n") == []


def test_a_local_image_polls_nothing():
    assert problems('[[image]]\nunit = 1\ncoils = 1\nread = []\nstale = "1 s"\n') == [
        'error: image[0].read: only a mirror has this key | name the device to poll: of = "DEVICE"',
        'error: image[0].stale: only a mirror has this key | name the device to poll: of = "DEVICE"',
    ]


MIRROR = '[[image]]\nunit = 241\nof = "one"\nread = [{ holding = "0-1", every = "500 ms" }]\n'


def test_a_mirror_of_a_device():
    assert problems(LINE + MIRROR) == []


def test_a_mirror_of_a_unit_behind_another_server():
    upstream = '[[upstream]]\nname = "x"\nto = "tcp://10.0.0.1"\nunits = [{ as = "2-3", unit = "7-8" }]\n'
    assert problems(upstream + MIRROR.replace("one", "x/3")) == []
    assert problems(upstream + MIRROR.replace("one", "x/7")) == [
        'error: image[0].of: there is no device "x/7" | did you mean "x/2" or "x/3"?'
    ]


def test_a_mirror_of_an_unknown_device():
    assert problems(LINE + MIRROR.replace("one", "on")) == [
        'error: image[0].of: there is no device "on" | did you mean "one"?'
    ]


def test_a_mirror_is_of_the_name_of_a_device():
    assert problems(LINE.replace("unit = 1", "unit = 1, as = 41") + MIRROR.replace("one", "41")) == [
        'error: image[0].of: there is no device "41" | write the name of unit 41: of = "one"'
    ]
    assert problems(LINE + MIRROR.replace('"one"', "41")) == [
        "error: image[0].of: must be text | write the name of the device in quotes, not its number"
    ]


def test_a_mirror_of_a_device_that_passes_through():
    line = '[[line]]\nname = "a"\nport = "/dev/a"\n'
    assert problems(line + MIRROR.replace("one", "a/17")) == []
    assert problems(line + MIRROR.replace("one", "xyz")) == ['error: image[0].of: there is no device "xyz"']


def test_a_mirror_of_a_unit_that_does_not_pass_through():
    line = '[[line]]\nname = "a"\nport = "/dev/a"\n'
    upstream = '[[upstream]]\nname = "x"\nto = "tcp://10.0.0.1"\nunits = [{ as = 17, unit = 1 }]\n'
    assert problems(line + upstream + MIRROR.replace("one", "a/17")) == [
        'error: image[0].of: there is no device "a/17" | unit 17 is of upstream "x"'
    ]
    image = "[[image]]\nunit = 17\nholding = 4\n"
    assert problems(line + MIRROR.replace("one", "a/17") + image) == [
        'error: image[0].of: there is no device "a/17" | unit 17 is of image "image-17"'
    ]


def test_a_mirror_of_a_device_whose_line_failed_may_exist():
    assert problems('[[line]]\nport = "a"\n' + MIRROR) == [
        'error: line[0].port: "a" is not an absolute path | did you mean "/dev/a"?'
    ]


def test_a_mirror_of_a_device_whose_line_has_an_asterisk_in_its_name():
    """It stands for a unit in a device's own name only."""
    line = '[[line]]\nname = "a*"\nport = "/dev/a"\n'
    for devices in ("", "devices = [{ unit = 1 }]\n"):
        loaded = parse(line + devices + MIRROR.replace("one", "a*/1"), port_trouble=lambda _: None)
        assert resolve(loaded.config).mirrors[0].of == "a*/1"


def test_a_mirror_has_nothing_of_its_own():
    assert problems(LINE + MIRROR + 'holding = 5\npersist = "never"\n') == [
        "error: image[0].holding: a mirror has what its device has | take the key out, or of",
        "error: image[0].persist: a mirror has what its device has | take the key out, or of",
    ]


def test_a_mirror_polls_something():
    assert problems(LINE + '[[image]]\nunit = 241\nof = "one"\n') == [
        ('error: image[0]: is a mirror that polls nothing | write read = [{ holding = "0-1", every = "500 ms" }]')
    ]


@pytest.mark.parametrize("areas", ["", "coils = 1, holding = 1, "])
def test_a_poll_reads_one_area(areas):
    text = LINE + f'[[image]]\nunit = 241\nof = "one"\nread = [{{ {areas}every = "1 s" }}]\n'
    assert problems(text) == ["error: image[0].read[0]: must name one of holding, input, coils and discrete"]


def test_a_mirror_polls_an_address_at_least():
    text = LINE + '[[image]]\nunit = 241\nof = "one"\nread = [{ holding = 0, every = "1 s" }]\n'
    assert problems(text) == [
        "error: image[0].read[0].holding: names no address | write the first and the last one, such as 0-9"
    ]


@pytest.mark.parametrize(("scheme", "frames"), [("rtu+tcp", "RTU"), ("ascii+tcp", "ASCII")])
def test_a_device_server_at_the_port_of_modbus_tcp_is_noted(scheme, frames):
    line = f'[[line]]\nport = "{scheme}://10.1.0.9:502"\n'
    assert problems(line) == [
        (
            f"warning: line[0].port: port 502 is that of Modbus TCP, and {scheme}:// sends bare {frames} frames"
            ' | if the server speaks Modbus TCP: [[upstream]] with to = "tcp://10.1.0.9:502"'
        )
    ]
    assert problems(line.replace("502", "4001")) == []


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


def test_a_mirror_polls_an_address_once():
    rows = '{ holding = "0-9", every = "1 s" }, { holding = "9-12", every = "2 s" }, { input = "9", every = "1 s" }'
    text = LINE + f'[[image]]\nunit = 241\nof = "one"\nread = [{rows}]\n'
    assert [said for said in problems(text) if said.startswith("error")] == [
        "error: image[0].read[1].holding: holding 9-12 overlap with an earlier row"
    ]


def test_a_mirror_polls_what_its_device_has():
    line = '[[line]]\nport = "/dev/a"\nmode = "ascii"\ndevices = [{ unit = 1, name = "press", profile = "mint" }]\n'
    rows = '{ holding = "0-1", every = "1 s" }, { input = "1-2", every = "1 s" }, { coils = "0-7", every = "1 s" }'
    assert problems(line + f'[[image]]\nunit = 241\nof = "press"\nread = [{rows}]\n') == [
        "error: image[0].read[0].holding: press does not have all of holding 0-1 | its holding: 1-99",
        "error: image[0].read[1].input: press has no function 4, which reads input",
    ]


@pytest.mark.parametrize("every", ["2 s", "5 s"])
def test_a_mirror_whose_values_are_stale_before_they_are_polled_again(every):
    text = LINE + MIRROR.replace("500 ms", every)
    assert problems(text) == [
        (
            "warning: image[0].read[0].every: values become stale between two polls: stale is 2 s"
            " | make stale two or three times as long as every"
        )
    ]


def test_addresses_of_a_mirror_count_from_0_too():
    assert problems(LINE + MIRROR.replace("0-1", "40001-40002")) == [
        (
            "warning: image[0].read[0].holding: addresses are those on the wire, from 0"
            " | " + told("holding", 40001, 40001, '"0-1"')
        )
    ]


SUNSPEC = '{ name = "marker", holding = 40000, type = "uint32" }, { name = "power", holding = 40084, type = "int16" }'


@pytest.mark.parametrize(
    "profile",
    [
        f"points = [{SUNSPEC}]",
        'holding = "40000-40200"\npoints = [{ name = "power", holding = 40084 }]',
        'input = "30000-39999"\npoints = [{ name = "power", input = 30775, type = "int32" }]',
        'points = [{ name = "power", holding = 30775, type = "int32" }]',
    ],
)
def test_devices_with_such_addresses_on_the_wire_are_not_told_to_have_others(profile):
    assert problems(LINE + f"[profile.x]\n{profile}\n") == []


def test_what_is_polled_of_such_a_device_or_is_its_own_point_is_not_either():
    device = '[[line]]\nname = "l"\nport = "/dev/l"\ndevices = [{ unit = 1, name = "one", profile = "x"POINTS }]\n'
    of_profile = f"[profile.x]\npoints = [{SUNSPEC}]\n"
    polled = '[[image]]\nunit = 241\nof = "one"\nread = [{ holding = "40070-40090", every = "500 ms" }]\n'
    own = ', points = [{ name = "state", holding = 40107 }]'
    assert problems(device.replace("POINTS", own) + of_profile + polled) == []
    assert problems(device.replace("POINTS", f", points = [{SUNSPEC}]").replace('"x"', '"generic"') + polled) == []


# The web


@pytest.mark.parametrize("bind", ["http://127.0.0.1:8502", "http://localhost:8502", "http://[::1]:8502"])
def test_metrics_for_this_machine_need_no_token(bind):
    assert problems(LINE + f'[web]\nbind = "{bind}"\n') == []


@pytest.mark.parametrize("bind", ["http://0.0.0.0:8502", "http://[::]:8502", "http://gw.plant:8502"])
def test_what_other_machines_can_reach_needs_users_or_a_token(bind):
    text = f'{LINE}[web]\nbind = "{bind}"\n'
    (problem,) = problems(text)
    assert problem.startswith("error: web.bind: other machines can reach it, so it needs users, or a token")
    assert problems(f'{text}token = {{ file = "t" }}\n') == []


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            'bind = "https://127.0.0.1:1"',
            ["error: web.bind: https:// needs certificate", "error: web.bind: https:// needs key"],
        ),
        ('bind = "https://127.0.0.1:1"\nkey = "k"', ["error: web.bind: https:// needs certificate"]),
        ('bind = "http://127.0.0.1:1"\nkey = "k"', ["error: web.key: is used only with https://"]),
        ('bind = "https://0.0.0.0:1"\nkey = { credential = "k" }\ncertificate = "c"\nusers = "u"', []),
        ('bind = "http://0.0.0.0:1"\nusers = "u"', ["warning: web.bind: passwords come in plain text"]),
        ('bind = "http://0.0.0.0:1"\nusers = "u"\nproxy = ["10.0.0.2"]', []),
        ('bind = "http://0.0.0.0:1"\nproxy = ["10.0.0.2"]', []),
        (
            'bind = "http://127.0.0.1:1"\nproxy = ["127.0.0.1"]',
            ["warning: web.proxy: every account and program on this"],
        ),
        ('bind = "http://0.0.0.0:1"\nproxy = ["::/0"]', ["warning: web.proxy: every account and program on this"]),
        ('bind = "http://127.0.0.1:1"\nwrite = true', ["error: web.write: nobody can log in, so nobody can write"]),
        ('bind = "http://127.0.0.1:1"\nwrite = true\nusers = "u"', []),
    ],
)
def test_what_the_web_page_needs(keys, said):
    found = problems(f"{LINE}[web]\n{keys}\n")
    assert len(found) == len(said)
    assert all(problem.startswith(start) for problem, start in zip(sorted(found), sorted(said), strict=True))


@pytest.mark.parametrize("key", ["{ credential = '../key' }", "{ credential = '' }", "''", "{ file = 'k' }", "7"])
def test_what_names_no_key_is_an_error(key):
    (problem,) = problems(f"{LINE}[web]\nbind = 'https://127.0.0.1:1'\ncertificate = 'c'\nkey = {key}\n")
    assert "web.key: names no file" in problem


@pytest.mark.parametrize("name", ["web", "control"])
def test_names_that_access_has_for_others_are_taken(name):
    found = problems(f'{LINE}[[listen]]\nname = "{name}"\nbind = "tcp://127.0.0.1:5020"\n')
    assert any(f'listen[0].name: "{name}" is what [[access]] calls' in problem for problem in found)


def test_a_row_of_access_may_name_the_web_page_and_networks():
    row = '[[access]]\nlisten = ["web"]\nfrom = ["10.0.0.0/24"]\nallow = ["read"]\n'
    assert problems(LINE + row) == []


def test_what_has_no_effect_is_told_once():
    assert problems('site = "plant-2"\n' + LINE) == ["warning: site: has no effect without [web], [mqtt] or [fleet]"]


def test_the_name_of_the_plant_has_no_effect_alone():
    said = "warning: site: has no effect without [web], [mqtt] or [fleet]"
    assert problems('site = "plant-2"\n' + LINE) == [said]
    assert problems('site = ""\n' + LINE) == []


def test_what_is_off_needs_no_warning():
    text = LINE + '[[image]]\nunit = 2\ncoils = 1\npersist = "never"\n'
    assert problems(text) == []


# What devices speak


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            'port = "/dev/a"\ndevices = [{ unit = 1, profile = "mint" }]',
            'line[0].devices[0].profile: mint devices use ASCII, but this line RTU | set mode = "ascii" for the line',
        ),
        (
            'port = "/dev/a"\nmode = "ascii"\nprofile = "weigher"',
            'line[0].profile: weigher devices use RTU, but this line ASCII | set mode = "rtu" for the line',
        ),
        (
            'port = "rtu+tcp://10.1.0.9:4001"\nprofile = "mint"',
            "line[0].profile: mint devices use ASCII, but this line RTU | set ascii+tcp:// in port for the line",
        ),
    ],
)
def test_a_line_that_its_devices_do_not_speak(line, said):
    assert problems(f"[[line]]\n{line}") == [f"warning: {said}"]


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_devices_that_speak_both(mode):
    assert problems(f'[[line]]\nport = "/dev/a"\nmode = "{mode}"\nprofile = "v80"') == []


def test_a_time_out_that_is_shorter_than_the_table_it_replaces():
    line = '[[line]]\nport = "/dev/a"\nmode = "ascii"\nprofile = "mint"\ndevices = [{ unit = 1, timeout = "%s" }]'
    assert problems(line % "1 s") == []
    (said,) = problems(line % "100 ms")
    assert said == (
        "warning: line[0].devices[0].timeout: is shorter than the 500 ms of mint for 99 items (function 23)"
        " | leave timeout out: the profile has a time for each request"
    )


# The gateway itself


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


@pytest.mark.parametrize("bind", ["http://127.0.0.1:8502", "http://[::1]:8502"])
def test_the_web_page_needs_an_address_of_its_own(bind):
    host = bind.removeprefix("http://")
    text = LINE + f'[[listen]]\nbind = "tcp://{host}"\n[web]\nbind = "{bind}"\n'
    assert problems(text) == ["error: web.bind: this address is already used in gateway.toml:5"]


@pytest.mark.parametrize(
    ("listeners", "said"),
    [
        ("", ["this address is already used by the default listener"]),
        (
            '[[listen]]\nbind = "tcp://[::]:5020"\n',
            ["this address is already used in gateway.toml:5; [::] takes IPv4 clients too"],
        ),
        ('[[listen]]\nbind = "tcp://[::]:5020"\n[[listen]]\nbind = "tcp://10.0.0.1:5020"\n', []),
        ('[[listen]]\nbind = "udp://127.0.0.1:5020"\n', []),
    ],
)
def test_the_web_page_collides_with_what_takes_clients_at_its_address(listeners, said):
    found = problems(f'{LINE}{listeners}[web]\nbind = "http://127.0.0.1:5020"\n')
    assert [one for one in found if one.startswith("error")] == [f"error: web.bind: {each}" for each in said]
