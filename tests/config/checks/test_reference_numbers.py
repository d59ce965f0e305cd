"""Numbers of a manual that are taken for addresses."""

import pytest

from kit.config_problems import LINE, problems

MIRROR = '[[image]]\nunit = 241\nof = "one"\nread = [{ holding = "0-1", every = "500 ms" }]\n'


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
