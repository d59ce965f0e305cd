"""Profiles, and the devices that have them."""

import pytest

from kit.config_problems import LINE, problems

UPSTREAM = '[[upstream]]\nto = "tcp://10.1.0.5"\nunits = [{ as = 37, unit = 7 }]\n'


@pytest.mark.parametrize(
    ("text", "path"),
    [
        (LINE + 'profile = "wiegher"\n', "line[0]"),
        (LINE.replace('name = "one"', 'profile = "wiegher"'), "line[0].devices[0]"),
        ('[[image]]\nunit = 1\ncoils = 1\nprofile = "wiegher"\n', "image[0]"),
        (UPSTREAM.replace("to =", 'profile = "wiegher"\nto ='), "upstream[0]"),
        (UPSTREAM.replace("unit = 7", 'unit = 7, profile = "wiegher"'), "upstream[0].units[0]"),
    ],
)
def test_a_profile_that_does_not_exist(text, path):
    remedy = 'did you mean "weigher"? modbus-gateway profile list shows all'
    assert problems(text) == [f'error: {path}.profile: there is no profile "wiegher" | {remedy}']


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


def test_the_same_behind_another_server():
    text = UPSTREAM.replace("unit = 7", 'unit = 7, profile = "mint", timeout = "100 ms"')
    (said,) = problems(text)
    assert said.startswith("warning: upstream[0].units[0].timeout: is shorter than the 500 ms of mint for 99 items")


@pytest.mark.parametrize("part", ["line", "upstream"])
def test_a_time_out_that_no_device_has(part):
    """A profile that a device names has times of its own."""
    text = {"line": LINE, "upstream": UPSTREAM}[part] + 'timeout = "300 ms"\n'
    assert problems(text) == []
    said = f"warning: {part}[0].timeout: has no effect: each device has a profile or a time-out of its own"
    for own in ('profile = "v80"', 'timeout = "2 s"'):
        (found,) = problems(text.replace("unit = ", f"{own}, unit = "))
        assert found.startswith(said)


def test_the_time_out_is_for_units_that_are_not_named():
    text = UPSTREAM.replace("unit = 7", 'unit = 7, profile = "v80"') + 'name = "u"\ntimeout = "300 ms"\n'
    assert problems(text + '[[listen]]\nbind = "tcp://127.0.0.1:5020"\nupstream = "u"\n') == []


@pytest.mark.parametrize(("profile", "is_wrong"), [("weigher", True), ("v80", False)])
def test_a_device_that_can_move_and_shares_its_address_is_a_warning(profile, is_wrong):
    rows = f'{{ unit = 3, as = 41, name = "a", profile = "{profile}" }}, {{ unit = "2-3", name = "b-*" }}'
    found = problems(f'[[line]]\nport = "/dev/x"\ndevices = [{rows}]\n')
    said = "3 is in another row too, and a weigher can change its address"
    help_ = "neither is asked while the other may be at this address"
    assert (f"warning: line[0].devices[0].unit: {said} | {help_}" in found) == is_wrong
    assert any("already has the unit ID 41 for clients" in each for each in found)
