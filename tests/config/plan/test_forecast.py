"""The time limits that a plan leads to."""

import pytest

from gateway.config.load import parse
from gateway.config.plan.forecast import (
    FunctionLimits,
    function_limits,
    guard,
    heard_window,
    longest_wait,
    longest_wait_outside,
    longest_waits,
    longest_waits_behind,
    owed_after_waking,
    waits_behind,
)
from gateway.config.plan.profiles import profile_of
from gateway.config.reading.profile_file import shipped_profile
from gateway.config.resolve import resolve
from gateway.config.schema.profile import ProfileTable
from gateway.listeners.sessions.server_line import UNNOTICED
from gateway.modbus.pdu import parse_request
from gateway.timing.budget import AnswerTime, Budget
from gateway.timing.characters import CharacterFormat, LineTiming

RTU = LineTiming("rtu", 19200, CharacterFormat(8, "E", 1))
CHARACTER = 11 / 19200
LATENCY = 0.005


def limits_of(profile):
    answer_time = AnswerTime(profile.timing, profile.margin, profile.timeout)
    return {one.function: one for one in function_limits(profile, answer_time, Budget(RTU, LATENCY))}


def builtin(name):
    return profile_of(name, shipped_profile(name).table)


def own(**keys):
    return profile_of("own", ProfileTable.model_validate(keys))


def test_a_limit_is_the_response_on_the_wire_and_margin_times_table_and_latency():
    """A response of n registers has 5 + 2n characters; Mint takes 10 ms for 1 register and 420 ms for 99."""
    limits = limits_of(builtin("mint"))
    assert limits[3] == FunctionLimits(
        function=3,
        most=99,
        one_item=pytest.approx(7 * CHARACTER + 1.5 * 0.010 + LATENCY),
        most_items=pytest.approx(203 * CHARACTER + 1.5 * 0.420 + LATENCY),
        request=pytest.approx(8 * CHARACTER),
    )


@pytest.mark.parametrize(
    ("function", "most", "response", "request_size"),
    [
        (1, 2000, 255, 8),
        (2, 2000, 255, 8),
        (3, 125, 255, 8),
        (4, 125, 255, 8),
        (5, 1, 8, 8),
        (6, 1, 8, 8),
        (15, 1968, 8, 255),
        (16, 123, 8, 255),
        (22, 1, 10, 10),
        (23, 125, 255, 255),
    ],
)
def test_the_largest_request_of_each_function(function, most, response, request_size):
    limits = limits_of(builtin("generic"))[function]
    assert limits.most == most
    assert limits.request == pytest.approx(request_size * CHARACTER)
    assert limits.most_items == pytest.approx(response * CHARACTER + 1.0 + LATENCY)


def test_functions_without_items_are_one_row_with_the_longest_of_them():
    """An echo of 250 bytes is as long as a frame can be, both ways."""
    limits = limits_of(builtin("generic"))[None]
    assert (limits.most, limits.one_item) == (0, pytest.approx(256 * CHARACTER + 1.0 + LATENCY))
    assert limits.most_items == limits.one_item
    assert limits.request == pytest.approx(256 * CHARACTER)


@pytest.mark.parametrize(
    ("function", "request_size", "response"),
    [
        (7, 4, 5),
        (8, 256, 256),
        (11, 4, 8),
        (12, 4, 75),
        (17, 4, 256),
        (20, 12, 255),
        (21, 250, 250),
        (24, 6, 70),
        (43, 7, 256),
        (100, 256, 0),
    ],
)
def test_the_longest_of_each_function_without_items(function, request_size, response):
    limits = limits_of(own(functions=[function]))[function]
    assert limits.request == pytest.approx(request_size * CHARACTER)
    assert limits.most_items == pytest.approx(response * CHARACTER + 1.0 + LATENCY)


def test_a_profile_may_name_a_function_that_is_not_known():
    limits = limits_of(own(functions=[3, 100]))
    assert set(limits) == {3, 100}
    assert limits[100].most == 0


@pytest.mark.parametrize(
    ("keys", "function", "most"),
    [
        ({"limits": {"3": 20}}, 3, 20),
        ({"limits": {"3": 500}}, 3, 125),
        ({"holding": ["0-9", "20-59"]}, 3, 40),
        ({"holding": ["0-9"]}, 16, 10),
        ({"holding": ["0-9"], "limits": {"3": 4}}, 3, 4),
        ({"coils": 16}, 1, 16),
        ({"coils": 16}, 15, 16),
        ({"discrete": 16}, 2, 16),
        ({"discrete": 16}, 1, 2000),
        ({"input": 16}, 4, 16),
        ({"holding": 0}, 3, 1),
    ],
)
def test_the_most_items_are_those_that_protocol_profile_and_addresses_allow(keys, function, most):
    assert limits_of(own(**keys))[function].most == most


def test_the_longest_wait_is_in_the_queue_and_on_the_line_and_for_the_answer():
    text = '[[line]]\nport = "/dev/a"\nmax_wait = "3 s"\ndevices = [{ unit = 1, profile = "weigher" }]\n'
    config = parse(text, port_trouble=lambda _: None).config
    assert config is not None
    (line,) = resolve(config).lines
    read_most = 8 * CHARACTER + 255 * CHARACTER + 1.0 + LATENCY
    assert longest_wait(line, line.devices[0]) == pytest.approx(3.0 + 3.5 * CHARACTER + read_most)


@pytest.mark.parametrize(
    ("keys", "repeated"),
    [
        ('retry_within = "7 s"', 7.0),
        ('late_window = "500 ms"', 2 * (255 * CHARACTER + 1.0 + LATENCY + 0.5)),
        ('late_window = "5 ms"', 2 * (263 * CHARACTER + 1.0 + LATENCY) + 0.005 + 16 * CHARACTER + 0.05),
        ("", 6 * (255 * CHARACTER + 1.0 + LATENCY)),
    ],
)
def test_a_read_that_is_sent_again_takes_longer(keys, repeated):
    text = f'[[line]]\nport = "/dev/a"\nretries = 1\n{keys}\ndevices = [{{ unit = 1, profile = "weigher" }}]\n'
    config = parse(text, port_trouble=lambda _: None).config
    assert config is not None
    (line,) = resolve(config).lines
    assert longest_wait(line, line.devices[0]) == pytest.approx(2.0 + 3.5 * CHARACTER + repeated)


SERVED = """
[[line]]
name = "a"
port = "/dev/a"
latency = "5 ms"
devices = [{ unit = 1, as = 41, name = "silo", profile = "weigher" }]
[[image]]
unit = 200
coils = 1
[[image]]
unit = 241
of = "silo"
read = [{ holding = "0-1", every = "1 s" }]
[[line]]
name = "panel"
port = "/dev/p"
role = "server"
latency = "20 ms"
"""


@pytest.mark.parametrize(
    ("keys", "answer"),
    [
        ("serves = 41", 1.0),
        ("serves = 200", 1.0),
        ('serves = 200\nanswer_within = "10 s"', 10.0),
    ],
)
def test_an_outside_client_may_wait_for_answer_within_whatever_it_asks(keys, answer):
    """A gateway that stood still answers then, an image too."""
    config = parse(SERVED + keys, port_trouble=lambda _: None).config
    assert config is not None
    plan = resolve(config)
    longest = longest_wait_outside(plan.servers[0])
    assert longest == pytest.approx(answer + UNNOTICED + 3.5 * CHARACTER + 0.020 + 256 * CHARACTER)


def test_who_stands_behind_a_server_line():
    config = parse(SERVED + "serves = [200, 41, 241]", port_trouble=lambda _: None).config
    assert config is not None
    plan = resolve(config)
    silo = longest_wait(plan.lines[0], plan.lines[0].devices[0])
    assert waits_behind(plan.servers[0], plan) == {
        41: ("silo", silo),
        200: ("image-200", 0.0),
        241: ("image-241", silo),
    }


def test_a_server_line_may_serve_a_mirror_of_a_unit_behind_an_upstream():
    config = parse(
        '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\nserves = [5]\n'
        '[[upstream]]\nname = "plant"\nto = "tcp://10.0.0.1"\nunits = [{ as = 37, unit = 37 }]\n'
        '[[image]]\nunit = 5\nname = "m"\nof = "plant/37"\nread = [{ holding = "0-1", every = "1 s" }]\n',
        port_trouble=lambda _: None,
    ).config
    assert config is not None
    plan = resolve(config)
    assert waits_behind(plan.servers[0], plan) == {5: ("m", *longest_waits_behind(plan.upstreams[0]).values())}


def line_of(keys: str, row: str = "unit = 1", profile: str = "functions = [3, 6]"):
    text = f'[[line]]\nport = "/dev/a"\nprofile = "w"\n{keys}\ndevices = [{{ {row} }}]\n[profile.w]\n{profile}\n'
    config = parse(text, port_trouble=lambda _: None).config
    assert config is not None
    return resolve(config).lines[0]


def limits_of_line(line):
    device = line.devices[0]
    return function_limits(device.profile, device.answer_time, line.budget)


def test_a_silence_after_connecting_is_part_of_the_wait_and_of_no_transaction():
    connected, silent = (
        resolve(parse('[[line]]\nport = "rtu+tcp://10.0.0.9:4001"\ndevices = [{ unit = 1 }]\n' + keys).config).lines[0]
        for keys in ("", 'after_connect = "500 ms"\n')
    )
    difference = longest_wait(silent, silent.devices[0]) - longest_wait(connected, connected.devices[0])
    assert difference == pytest.approx(0.5)
    assert guard(silent) == pytest.approx(guard(connected))


@pytest.mark.parametrize("retries", [0, 1])
def test_a_read_that_wakes_its_device_is_sent_once_more(retries):
    awake, asleep = (line_of(f"retries = {retries}", row) for row in ("unit = 1", 'unit = 1, wake = "10 s"'))
    (limits,) = (each for each in limits_of_line(asleep) if each.function == 3)
    difference = longest_wait(asleep, asleep.devices[0]) - longest_wait(awake, awake.devices[0])
    assert difference == pytest.approx(limits.request + limits.most_items)
    assert longest_wait(asleep, asleep.devices[0], repeats=False) == longest_wait(
        awake, awake.devices[0], repeats=False
    )


def test_each_device_of_a_line_has_its_own_wait():
    line = line_of("", 'unit = 1, wake = "10 s" }, { unit = 2')
    waits = longest_waits(line)
    assert waits[line.devices[0].name] > waits[line.devices[1].name]


def test_the_other_answer_of_a_device_that_was_woken_is_awaited_until_its_late_window_ends():
    line = line_of('late_window = "700 ms"', 'unit = 1, wake = "10 s"')
    (limits,) = (each for each in limits_of_line(line) if each.function == 3)
    assert owed_after_waking(line, line.devices[0]) == pytest.approx(limits.most_items + 0.7)


def test_no_other_answer_is_owed_by_a_device_that_never_sleeps_or_is_never_read():
    awake, written = line_of(""), line_of('wake = "10 s"', profile="functions = [6]")
    assert (owed_after_waking(awake, awake.devices[0]), owed_after_waking(written, written.devices[0])) == (0.0, 0.0)
    assert longest_wait(written, written.devices[0]) == longest_wait(written, written.devices[0], repeats=False)


def test_a_device_without_any_read_on_a_line_that_repeats_reads():
    line = '[[line]]\nport = "/dev/a"\nretries = {}\nprofile = "w"\ndevices = [{{ unit = 1 }}]\n'
    text = line + "[profile.w]\nfunctions = [6]\n"
    once, repeated = (resolve(parse(text.format(retries)).config).lines[0] for retries in (0, 2))
    assert longest_wait(repeated, repeated.devices[0]) == longest_wait(once, once.devices[0])


def test_a_mirror_of_a_unit_that_only_a_listener_of_its_line_leads_to():
    """The mirror has taken the unit's number everywhere else."""
    config = parse(
        '[[line]]\nname = "b"\nport = "/dev/b"\n'
        '[[line]]\nport = "/dev/a"\nrole = "server"\nserves = [6]\n'
        '[[image]]\nunit = 6\nname = "m"\nof = "b/6"\nread = [{ holding = 1, every = "1 s" }]\n'
        '[[listen]]\nbind = "tcp://0.0.0.0:502"\nline = "b"\n',
        port_trouble=lambda _: None,
    ).config
    assert config is not None
    plan = resolve(config)
    line = plan.lines[0]
    (device,) = [device for device in line.devices if device.unit == 6]
    assert waits_behind(plan.servers[0], plan) == {6: ("m", longest_wait(line, device))}


@pytest.mark.parametrize(
    ("keys", "window"),
    [
        ("unit = 3", 5.0),
        ('unit = 3, timeout = "400 ms"', 5.0),
        ('unit = 3, timeout = "4 s"', 2 * (7 * CHARACTER + 4.0 + LATENCY)),
        ('unit = 3, profile = "mint"', 1.0),
        ('unit = 3, profile = "mint", timeout = "4 s"', 2 * (7 * CHARACTER + 4.0 + LATENCY)),
    ],
)
def test_an_answer_that_is_heard_may_be_as_slow_as_any_and_twice_as_slow_as_the_limit(keys, window):
    text = f'[[line]]\nport = "/dev/x"\nrole = "monitor"\nlatency = "5 ms"\ndevices = [{{ {keys} }}]'
    plan = resolve(parse(text, port_trouble=lambda _: None).config).monitors[0]
    asked = parse_request(bytes.fromhex("03 0000 0001"))
    assert heard_window(plan, plan.devices[0], asked) == pytest.approx(window)
    assert heard_window(plan, plan.devices[0]) >= window
    assert heard_window(plan, None, asked) == 5.0


def test_the_late_window_of_a_monitor_line_is_that_of_all_its_units():
    text = (
        '[[line]]\nport = "/dev/x"\nrole = "monitor"\nlate_window = "2 s"\ndevices = [{ unit = 3, profile = "mint" }]'
    )
    plan = resolve(parse(text, port_trouble=lambda _: None).config).monitors[0]
    asked = parse_request(bytes.fromhex("03 0000 0001"))
    assert {heard_window(plan, device, asked) for device in (None, *plan.devices)} == {2.0}
    assert heard_window(plan, plan.devices[0]) == 2.0
