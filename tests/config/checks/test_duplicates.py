"""What may be used once only."""

import pytest

from kit.config_problems import LINE, problems

SERVER = '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\n'


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
    said = 'error: line[1].name: "a" is already used in gateway.toml:1 | give it another one: name = "..."'
    assert said in problems(text)


def test_two_listeners_on_free_ports_that_have_no_names():
    free_port = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n'
    (said,) = problems(LINE + free_port + free_port)
    assert said.endswith('"tcp://127.0.0.1:0" is already used in gateway.toml:5 | give it another one: name = "..."')


def test_two_devices_with_one_name():
    text = LINE.replace("}]", '},\n  { unit = 2, name = "one" }]')
    assert problems(text) == ['error: line[0].devices[1].name: "one" is already used in gateway.toml:4, devices[0]']


def test_a_device_that_is_called_as_one_without_a_name():
    """A mirror of a/2 would ask the wrong unit."""
    text = LINE.replace("}]", '},\n  { unit = 2 }, { unit = 3, name = "a/2" }]')
    assert problems(text) == ['error: line[0].devices[2].name: "a/2" is already used in gateway.toml:5, devices[1]']


def test_a_device_that_is_called_as_a_unit_behind_another_server():
    text = LINE.replace('"one"', '"u/7"') + (
        '[[upstream]]\nname = "u"\nto = "tcp://10.0.0.1"\nunits = [{ as = 7, unit = 1 }]\n'
    )
    assert problems(text) == ['error: line[0].devices[0].name: "u/7" is already used in gateway.toml:8, units[0]']


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
    said = 'error: image[0].name: "one" is already used in gateway.toml:4, devices[0]'
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


def test_two_upstreams_with_one_name():
    one = '[[upstream]]\nname = "x"\nto = "tcp://10.0.0.1"\nunits = [{{ as = {0}, unit = 1 }}]\n'
    assert problems(one.format(1) + one.format(2)) == ['error: upstream[1].name: "x" is already used in gateway.toml:1']


def test_a_line_and_an_upstream_with_one_name():
    text = LINE + '[[upstream]]\nname = "a"\nto = "tcp://10.0.0.1"\nunits = [{ as = 2, unit = 2 }]\n'
    assert problems(text) == ['error: upstream[0].name: "a" is already used in gateway.toml:1']


def test_the_name_of_the_control_socket_is_taken():
    text = LINE + '[[listen]]\nname = "control"\nbind = "tcp://127.0.0.1:1"\n'
    assert problems(text) == ['error: listen[0].name: "control" is what [[access]] calls the control socket']


def test_who_has_no_name_is_not_blamed_for_being_called_after_a_place_that_is_taken():
    line = '[[line]]\nport = "/dev/a"\ndevices = [{{ unit = {} }}]\n'
    assert problems(line.format(1) + line.format(2)) == [
        "error: line[1].port: this port is already used in gateway.toml:1"
    ]
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:1"\n'
    assert problems(LINE + listen + listen) == ["error: listen[1].bind: this address is already used in gateway.toml:5"]


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


def test_two_server_lines_with_one_name_are_told_once():
    text = LINE + SERVER + "serves = 1\n" + SERVER.replace("/dev/p", "/dev/q") + "serves = 1\n"
    assert problems(text) == ['error: line[2].name: "panel" is already used in gateway.toml:5']


@pytest.mark.parametrize("name", ["web", "control"])
def test_names_that_access_has_for_others_are_taken(name):
    found = problems(f'{LINE}[[listen]]\nname = "{name}"\nbind = "tcp://127.0.0.1:5020"\n')
    assert any(f'listen[0].name: "{name}" is what [[access]] calls' in problem for problem in found)


@pytest.mark.parametrize(
    ("rows", "name"),
    [
        ('{ unit = 5, as = "none" }, { unit = 5, as = "none" }', "a/5"),
        ('{ unit = 5, as = 41 }, { unit = 41, as = "none" }', "a/41"),
        ('{ unit = "40-41", as = "none" }, { unit = 5, as = 41 }', "a/41"),
        ('{ unit = 5, as = "none" }, { unit = 6, name = "a/5" }', "a/5"),
    ],
)
def test_a_device_without_a_unit_has_a_name_of_its_own(rows, name):
    """Its number on the wire may be that of another one for clients, and its name is all that tells them apart."""
    text = f'[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{rows}]\n'
    errors = [each for each in problems(text) if each.startswith("error")]
    assert len(errors) == 1
    assert f'"{name}" is already used in' in errors[0]


def test_two_lines_of_one_name_are_one_error():
    text = '[[line]]\nname = "a"\nport = "/dev/{}"\ndevices = [{{ unit = "1-9", as = "none" }}]\n'
    assert len(problems(text.format("a") + text.format("b"))) == 1
