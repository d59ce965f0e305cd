"""Images and mirrors."""

import pytest

from gateway.config.load import parse
from gateway.config.problem import WrongValue
from gateway.config.resolve import resolve
from gateway.modbus.codes import Area
from kit.config_problems import LINE, problems


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


def test_a_local_image_polls_nothing():
    assert problems('[[image]]\nunit = 1\ncoils = 1\nread = []\nstale = "1 s"\n') == [
        'error: image[0].read: only a mirror has this key | name the device to poll: of = "DEVICE"',
        'error: image[0].stale: only mirrors and virtual units have this key | name the device to poll: of = "DEVICE"',
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
        'error: image[0].of: there is no device "41" | write the name of unit 41: "one"'
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


MADE = '[[image]]\nunit = 60\npython = "clock:Clock"\n'


def test_a_unit_made_in_python_has_all_addresses_unless_it_names_some():
    every = ((0, 65535),)
    assert problems(MADE) == []
    [one] = resolve(parse(MADE).config).images
    assert (one.python, one.timeout, {*one.areas.values()}, len(one.areas)) == ("clock:Clock", 1.0, {every}, 4)
    [one] = resolve(parse(MADE + 'timeout = "200 ms"\nholding = "5-9"\n').config).images
    assert (one.timeout, one.areas) == (0.2, {Area.HOLDING: ((5, 9),)})


def test_a_unit_made_in_python_has_the_addresses_of_its_profile():
    profile = '[profile.meter]\nholding = "0-3"\ncoils = []\n'
    [one] = resolve(parse(MADE + 'profile = "meter"\n' + profile).config).images
    assert one.areas == {
        Area.HOLDING: ((0, 3),),
        Area.INPUT: ((0, 65535),),
        Area.DISCRETE: ((0, 65535),),
    }


def test_a_unit_made_in_python_has_nothing_of_the_other_kinds():
    keys = ['of = "one"', 'read = [{ holding = 0, every = "1 s" }]', 'stale = "1 s"', 'when_stale = "hold"']
    keys += ['persist = "always"', "initial.holding = [{ at = 0, values = [1] }]", 'map = [{ at = 0, age = "one" }]']
    for key in keys:
        name = key.partition(" ")[0].partition(".")[0]
        assert (
            f"error: image[0].{name}: a unit made in Python has what its class says | take the key out, or python"
            in problems(MADE + key + "\n" + LINE)
        )


def test_only_a_unit_made_in_python_has_a_timeout():
    assert problems('[[image]]\nunit = 1\ncoils = 1\ntimeout = "1 s"\n') == [
        ('error: image[0].timeout: only a unit made in Python has this key | name its class: python = "module:Name"')
    ]


def test_why_a_class_cannot_be_used_is_an_error_at_its_place():
    found = parse(MADE, unit_trouble=lambda python: WrongValue(f"{python} is wrong", "mend it")).problems
    assert [str(each) for each in found] == [
        "gateway.toml:3:10: error: image[0].python: clock:Clock is wrong\n  help: mend it"
    ]


def test_a_row_of_a_virtual_unit_may_read_a_unit_made_in_python():
    row = '[[image]]\nunit = 61\nmap = [{ at = 0, device = "image-60", holding = "0-3", every = "1 s" }]\n'
    assert problems(MADE + row) == []
