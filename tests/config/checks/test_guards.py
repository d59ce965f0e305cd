"""What `check` says of points with limits."""

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.profiles.profile import GuardedProfile, Profile


def problems(*points: str, functions: str = "", of_profile: str = "") -> list[str]:
    listed = ",\n".join(f"{{ {point} }}" for point in points)
    text = f'[profile.mine]\n{functions}\npoints = [{of_profile}]\n[[line]]\nport = "/dev/x"\n'
    text += f'devices = [{{ unit = 6, profile = "mine", points = [\n{listed}\n] }}]\n'
    return [str(one).partition("points[")[2] for one in parse(text, port_trouble=lambda _: None).problems]


SPEED = 'name = "speed", holding = 10, type = "uint32", max = 1500, write = true'
MODE = 'name = "mode", holding = 20, bits = "4-6", max = 5, write = true'


@pytest.mark.parametrize(
    ("point", "problem"),
    [
        ("coils = 1, write = true, max = 1", "0].max: a bit is no number to be scaled, rounded or limited"),
        ("holding = 1, bit = 3, write = true, min = 0", "0].min: a bit is no number to be scaled, rounded or limited"),
        ('holding = 1, type = "string", length = 2, write = true, max = 1', "0].max: a string is no number"),
        ("holding = 1, write = true, min = 5, max = 4", "0].min: is more than max, which is 4"),
        ("holding = 1, write = true, min = 65536", "0].min: is more than the highest value"),
        (
            "holding = 1, scale = 10, min = 1, max = 9",
            "0].max: no value of the point is from 1 to 9: it has",
        ),
        ('holding = 1, bits = "0-2", max = 5, write = "only"', "0].write: bits with limits are written by reading"),
        (
            'holding = 1, type = "uint32", bits = "0-2", invalid = 7, max = 5, write = true',
            "0].invalid: numbers of several registers, and limits are for the one that is written",
        ),
    ],
)
def test_limits_that_cannot_be_guarded_are_errors(point: str, problem: str) -> None:
    (found,) = problems(f'name = "a", {point}')
    assert found.startswith(problem)


def test_bits_with_limits_need_more_than_function_22() -> None:
    (found,) = problems(MODE, functions="functions = [3, 22]")
    assert found.startswith("0].holding: cannot be written: function 6 or 16 is not among the functions of the profile")
    assert problems(MODE, functions="functions = [3, 6, 22]") == problems(MODE) == []


def test_only_devices_with_limits_have_guards() -> None:
    text = f"""
[profile.mine]
points = [{{ name = "seen", input = 1, max = 9 }}, {{ name = "set", holding = 1, write = true }}]
[[line]]
port = "/dev/x"
devices = [{{ unit = 6, profile = "mine" }}, {{ unit = 7, profile = "mine", points = [{{ {SPEED} }}] }}]
"""
    config = parse(text, port_trouble=lambda _: None).config
    assert config is not None
    kinds = [type(device.profile) for device in resolve(config).lines[0].devices]
    assert kinds == [Profile, GuardedProfile]
