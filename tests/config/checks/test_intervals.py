"""How often mirrors and maps read, and that nothing is read of what others ask on a monitor line."""

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.images.polls import Poll
from gateway.modbus.codes import Area
from kit.config_problems import LINE, problems

MONITOR = """[[line]]
name = "old-plc"
port = "/dev/plc"
role = "monitor"
devices = [{ unit = 3, as = 63, name = "boiler", points = [{ name = "power", holding = 4, type = "float32" }] }]
"""


def mirror(of: str, row: str) -> str:
    return f'{LINE}{MONITOR}[[image]]\nunit = 241\nof = "{of}"\nread = [{{ {row} }}]\n'


def mapped(row: str) -> str:
    return f"{LINE}{MONITOR}[[image]]\nunit = 240\nmap = [{{ at = 0, {row} }}]\n"


@pytest.mark.parametrize(
    "text",
    [
        mirror("boiler", 'holding = "0-9"'),
        mirror("one", 'holding = "0-9", every = "500 ms"'),
        mapped('device = "boiler", point = "power"'),
        mapped('device = "boiler", holding = "0-9"'),
        mapped('device = "boiler", point = "*"'),
        mapped('device = "one", holding = "0-9", every = "1 s"'),
    ],
)
def test_what_is_polled_has_an_interval_and_what_is_heard_has_none(text):
    assert problems(text) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            mirror("one", 'holding = "0-9"'),
            'error: image[0].read[0]: every is missing | say how often it is read, such as every = "500 ms"',
        ),
        (
            mapped('device = "one", holding = "0-9"'),
            'error: image[0].map[0]: every is missing | say how often it is read, such as every = "1 s"',
        ),
        (
            mirror("boiler", 'holding = "0-9", every = "1 s"'),
            (
                "error: image[0].read[0].every: others ask boiler, and the gateway only listens on old-plc: nothing is "
                "read there | take it out: values come when they are heard"
            ),
        ),
        (
            mapped('device = "boiler", point = "power", every = "1 s"'),
            (
                "error: image[0].map[0].every: others ask boiler, and the gateway only listens on old-plc: nothing is "
                "read there | take it out: values come when they are heard"
            ),
        ),
        (
            mapped('device = "boiler", holding = "0-9", write = true'),
            (
                "warning: image[0].map[0].write: nothing is ever sent on old-plc: writes to this row are answered 0A | "
                "take it out"
            ),
        ),
    ],
)
def test_what_is_wrong(text, said):
    assert problems(text) == [said]


def test_a_line_that_is_wrong_says_nothing_of_intervals():
    text = mirror("boiler", 'holding = "0-9", every = "1 s"').replace('role = "monitor"', 'role = "monitr"')
    assert [said for said in problems(text) if ".every" in said or "every is" in said] == []


def test_a_mirror_of_what_is_heard_keeps_single_registers_and_values_of_several_as_a_whole():
    plan = resolve(parse(mirror("boiler", 'holding = "3-6"'), port_trouble=lambda _: None, real_path=str).config)
    (settings,) = plan.mirrors
    assert settings.wanted == (
        Poll(Area.HOLDING, 3, 3, 0.0),
        Poll(Area.HOLDING, 4, 5, 0.0),
        Poll(Area.HOLDING, 6, 6, 0.0),
    )
