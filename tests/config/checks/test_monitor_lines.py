"""What a line with role = "monitor" may not have, and who must not name its devices: nothing is ever asked there."""

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from kit.config_problems import LINE


def problems(text):
    return [*parse(text, "gateway.toml", port_trouble=lambda _: None, real_path=str).problems]


LISTENERS = """
[[listen]]
bind = "tcp://127.0.0.1:5020"
[[listen]]
bind = "tcp://127.0.0.1:5021"
line = "old-plc"
"""


def monitor(keys="", device="", more=""):
    return f"""{LINE}[[line]]
name = "old-plc"
port = "/dev/plc"
role = "monitor"
{keys}
devices = [{{ unit = 3, as = 63, name = "boiler", points = [{{ name = "power", holding = 4 }}]{device} }}]
{more}"""


def mirrored(more):
    """The same with a mirror of its device, and points of it."""
    return monitor(more=f'[[image]]\nunit = 241\nname = "copy"\nof = "boiler"\nread = [{{ holding = "0-9" }}]\n{more}')


@pytest.mark.parametrize(
    "keys",
    ["", 'late_window = "2 s"', 'timeout = "300 ms"', 'wire = "direct"', 'rs485 = "adapter"'],
)
def test_what_it_may_have(keys):
    assert problems(monitor(keys)) == []


def test_it_needs_no_devices():
    assert problems(f'{LINE}[[line]]\nname = "old-plc"\nport = "/dev/plc"\nrole = "monitor"\n') == []


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ("retries = 1", "has no meaning"),
        ("queue = 8", "has no meaning"),
        ('max_wait = "1 s"', "has no meaning"),
        ('rest = "off"', "has no meaning"),
        ("coalesce = false", "has no meaning"),
        ('wake = "10 s"', "has no meaning"),
        ('retry_within = "1 s"', "has no meaning"),
        ('gap = "5 ms"', "has no meaning"),
        ('turnaround = "100 ms"', "has no meaning"),
        ("broadcast = false", "has no meaning"),
        ("echo = true", "has no meaning"),
        ('rs485 = "kernel"', "would switch a driver on"),
        ('serves = "1"', "has no meaning"),
        ('answer_within = "1 s"', "has no meaning"),
        ('on_failure = "silent"', "has no meaning"),
        ('broadcast_to = "all"', "has no meaning"),
    ],
)
def test_keys_that_have_no_use_there(keys, why):
    (problem,) = [each for each in problems(monitor(keys)) if each.path[-1] == keys.partition(" ")[0]]
    assert problem.severity == "error"
    assert 'role = "monitor"' in problem.what
    assert why in problem.what
    assert problem.remedy == "take it out"


@pytest.mark.parametrize("key", ['idle = "30 s"', 'after_connect = "1 s"'])
def test_its_connection_to_a_device_server_is_kept(key):
    text = monitor(key).replace('"/dev/plc"', '"rtu+tcp://10.1.0.9:4001"')
    assert ["only listens" in each.what for each in problems(text)] == [True]


@pytest.mark.parametrize("key", ['priority = "high"', 'wake = "10 s"'])
def test_keys_of_a_device_that_is_not_asked(key):
    (problem,) = problems(monitor(device=f", {key}"))
    assert "has no meaning" in problem.what


def test_a_device_is_known_by_its_own_address():
    (problem,) = problems(monitor().replace("unit = 3", "unit = 0"))
    assert "0 is everybody's" in problem.what


def test_no_listener_leads_there():
    (problem,) = problems(monitor(more=LISTENERS))
    assert problem.what == 'line "old-plc" only listens: nobody can ask there'


def test_a_right_to_its_device_is_a_right_to_0a():
    (problem,) = problems(monitor(more='[[access]]\nunits = 63\nallow = ["read", "write"]\n'))
    assert problem.severity == "warning"
    assert problem.what == "unit 63 is on a line that only listens: every request is answered with 0A"


@pytest.mark.parametrize("row", ['units = "60-70"', 'units = "all"'])
def test_rights_to_more_than_that_are_no_problem(row):
    assert problems(mirrored(f'[[access]]\n{row}\nallow = ["read"]\n')) == []


def test_a_server_line_that_serves_its_device_is_warned_of():
    (problem,) = problems(monitor(more='[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\nserves = "63"\n'))
    assert problem.severity == "warning"
    assert problem.what == "unit 63 is on a line that only listens: every request is answered with 0A"


def published(device):
    return mirrored(
        f'[mqtt]\nbroker = "mqtt://127.0.0.1"\npublish = [{{ device = "{device}", every = "1 s" }}]\n'
    ).replace("[[line]]", 'site = "plant"\n[[line]]', 1)


@pytest.mark.parametrize("device", ["boiler", "boil*"])
def test_what_is_only_heard_cannot_be_published_alone(device):
    (problem,) = problems(published(device))
    assert problem.what == 'line "old-plc" only listens, so nobody polls boiler'
    assert 'of = "boiler"' in problem.remedy


def test_a_pattern_leaves_it_out():
    text = published("*")
    assert problems(text) == []
    plan = resolve(parse(text).config)
    assert plan.mqtt.heard == ("boiler",)
    assert [each.name for each in plan.mqtt.devices] == ["copy"]
