"""`check` says which points are guarded, and where functions go past the guards."""

from gateway.cli.show.images import guarded_as_json, guarded_as_text
from gateway.config.load import parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve

PROFILE = """
[profile.drive]
{functions}
points = [
  {{ name = "speed", holding = 10, type = "int32", scale = 0.1, unit = "rpm", min = 0, max = 1500, write = true }},
  {{ name = "mode", holding = 8, bits = "4-6", max = 5, write = true }},
  {{ name = "shown", holding = 7, max = 5 }},
]
"""
DEVICES = """
[[line]]
port = "/dev/x"
devices = [
  { unit = "1-5", name = "drive-*", profile = "drive" },
  { unit = 9, name = "pump", points = [{ name = "level", input = 2, write_at = 100, min = -0.5, write = "only" }] },
]
[[image]]
unit = 200
name = "box"
holding = "0-10"
profile = "drive"
"""


def plan(text: str, functions: str = "functions = [3, 6, 16, 23]") -> Plan:
    loaded = parse(PROFILE.format(functions=functions) + text, port_trouble=lambda _: None)
    assert loaded.config is not None, loaded.problems
    return resolve(loaded.config)


def test_each_guarded_point_has_its_place_and_its_limits() -> None:
    (text,) = guarded_as_text(plan(DEVICES))
    assert text.splitlines() == [
        "Guarded points: every write to them is whole and within their limits, or 03",
        "  DEVICE                                POINT  WRITTEN AT     WITHIN",
        "  drive-1, drive-2, drive-3 and 2 more  mode   holding 8.4-6  at most 5",
        "  drive-1, drive-2, drive-3 and 2 more  speed  holding 10-11  0 to 1500 rpm",
        "  pump                                  level  holding 100    at least -0.5",
        "  box                                   mode   holding 8.4-6  at most 5",
        "  Functions whose meaning nobody knows may write there too: pump.",
        "  List those that you need in the profile: functions = [3, 6, 16]",
    ]


def test_functions_without_a_known_place_are_told_of_devices_only() -> None:
    for functions in ("functions = [3, 6, 16, 100]", "functions = [3, 8, 16]", "functions = [3, 16, 21]", ""):
        told = guarded_as_json(plan(DEVICES, functions))
        assert {name for each in told if each["has_unknown_functions"] for name in each["devices"]} == {
            *(f"drive-{number}" for number in range(1, 6)),
            "pump",
        }


def test_units_that_pass_through_are_shown_as_one() -> None:
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:5021"\nupstream = "far"\n'
    units = '[[upstream]]\nname = "far"\nto = "tcp://10.0.0.1"\nprofile = "drive"\nunits = [{ unit = 1, as = 7 }]\n'
    line = f'[[line]]\nname = "hall"\nport = "/dev/x"\nprofile = "drive"\n{listen}{units}'
    assert [each["devices"] for each in guarded_as_json(plan(line))] == [
        ["hall (each)", "far/7", "far (each other)"]
    ] * 2


def test_nothing_is_shown_without_guards() -> None:
    assert guarded_as_text(plan('[[line]]\nport = "/dev/x"\n')) == []
