"""What must fit together: each rule with a file that breaks it."""

from gateway.config.check import check
from gateway.config.load import parse
from gateway.config.resolve import Planning
from kit.config_problems import LINE, problems


def test_an_empty_file_serves_nothing():
    said = 'error: : there is no [[line]], and nothing else to serve | add [[line]] with port = "/dev/ttyUSB0"'
    assert problems("") == [said]


def test_an_image_alone_is_something_to_serve():
    assert problems("[[image]]\nunit = 200\nholding = 10\n") == []


def test_the_checks_can_be_had_for_a_config_without_any_file():
    config = parse(LINE).config
    assert config is not None
    assert list(check(Planning(config))) == []


def test_a_control_socket_whose_path_is_too_long():
    control = f'[control]\nsocket = "/run/{"x" * 102}"\n'
    assert problems(LINE + control) == []
    assert problems(LINE + control.replace("/run/", "/run/x")) == ["error: control.socket: is longer than 107 bytes"]


def test_a_control_socket_whose_path_no_system_takes():
    control = '[control]\nsocket = "/tmp/\\u0000x"\n'
    assert problems(LINE + control) == ["error: control.socket: has characters that cannot be seen"]


def test_a_port_that_cannot_be_used_is_a_warning():
    trouble = {"/dev/a": "is not a serial port"}
    assert problems(LINE, port_trouble=trouble.get) == [
        (
            "warning: line[0].port: is not a serial port"
            " | the line waits for it; modbus-gateway ports lists those that exist"
        )
    ]
    assert problems(LINE.replace("/dev/a", "/dev/b"), port_trouble=trouble.get) == []


def test_a_port_that_this_user_may_not_open_is_not_waited_for():
    trouble = {"/dev/a": "this user may not open it: ask for it"}
    assert problems(LINE, port_trouble=trouble.get) == ["warning: line[0].port: this user may not open it: ask for it"]


def test_what_has_no_effect_is_told_once():
    assert problems('site = "plant-2"\n' + LINE) == ["warning: site: has no effect without [web], [mqtt] or [fleet]"]


def test_the_name_of_the_plant_has_no_effect_alone():
    said = "warning: site: has no effect without [web], [mqtt] or [fleet]"
    assert problems('site = "plant-2"\n' + LINE) == [said]
    assert problems('site = ""\n' + LINE) == []


def test_what_is_off_needs_no_warning():
    text = LINE + '[[image]]\nunit = 2\ncoils = 1\npersist = "never"\n'
    assert problems(text) == []
