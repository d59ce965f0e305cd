"""Listeners for one line or upstream: each rule with a file that breaks it, and what rows mean there."""

import json

import pytest

from gateway.config.load import parse
from gateway.config.problem import dotted

LISTEN = '[[listen]]\nname = "{0}"\nbind = "tcp://127.0.0.1:{1}"\n'
SHARED = LISTEN.format("all", 5020)
A = LISTEN.format("port-a", 5021) + 'line = "a"\n'
B = LISTEN.format("port-b", 5022) + 'line = "b"\n'
LINE_A = '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = "1-2", as = "41-42" }, { unit = 0, as = 50 }]\n'
LINE_B = '[[line]]\nname = "b"\nport = "/dev/b"\n'
LINE_C = '[[line]]\nname = "c"\nport = "/dev/c"\n'
LONE = "any device on the line may answer unit 0"
PANEL = '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\nserves = 41\n'


def said(text):
    found = parse(text, "gateway.toml", port_trouble=lambda _: None, real_path=str).problems
    return [
        f"{one.severity}: {dotted(one.path)}: {one.what}" + (f" | {one.remedy}" if one.remedy else "")
        for one in found
        if not one.what.startswith(LONE)
    ]


def test_a_listener_for_one_line_beside_one_for_all():
    assert said(SHARED + A + LINE_A) == []


@pytest.mark.parametrize("lines", [LINE_A + LINE_B, LINE_B + LINE_A, LINE_B])
def test_a_line_that_has_a_listener_of_its_own_needs_no_devices(lines):
    assert said(SHARED + B + lines) == []


def test_two_lines_without_devices_need_a_listener_each():
    assert said(B + LISTEN.format("port-c", 5023) + 'line = "c"\n' + LINE_B + LINE_C) == []


def test_one_line_without_devices_can_do_without_a_listener_of_its_own():
    """All that the listener for all leads to is on that line."""
    assert said(SHARED + B + LINE_B + LINE_C) == []
    (problem,) = said(SHARED + B + LINE_B + LINE_C + LINE_A)
    assert problem.startswith("error: line[1]: has no devices, but is not the only client line")


APART = (
    "error: line[1]: has no devices, but is not the only client line: it is unknown which units are on it"
    " | name its devices, such as devices = [{ unit = 1 }], or give it its own [[listen]] with"
)


@pytest.mark.parametrize("line_a", [LINE_A, '[[line]]\nname = "a"\nport = "/dev/a"\n'])
def test_a_line_without_devices_to_which_nobody_leads(line_a):
    assert said(A + line_a + LINE_B) == [f'{APART} line = "b"']


MIRROR = '[[image]]\nunit = {0}\nof = "b/17"\nread = [{{ holding = "0", every = "1 s" }}]\n'


@pytest.mark.parametrize(
    ("text", "is_asked"),
    [
        (PANEL.replace("41", "17"), True),
        (PANEL + LINE_C + "devices = [{ unit = 41 }]\n", False),
        (MIRROR.format(17) + PANEL.replace("41", "17"), True),
        (MIRROR.format(200) + PANEL.replace("41", "200"), True),
    ],
)
def test_a_panel_and_a_mirror_lead_to_a_line_without_devices_too(text, is_asked):
    found = said(A + '[[line]]\nname = "a"\nport = "/dev/a"\n' + LINE_B + text)
    assert any(each.startswith(APART) for each in found) == (not is_asked)


UPSTREAM = '[[upstream]]\nto = "tcp://10.1.0.5:502"\nunits = [{ as = "71-73", unit = "1-3" }]\n'


def dead(place, units):
    what = f"no listener leads to {units}: each is for one line or upstream"
    return f"warning: {place}: {what} | add a [[listen]] without line and upstream"


@pytest.mark.parametrize(
    ("text", "place", "units"),
    [
        ("[[image]]\nunit = 255\nholding = 1\n", "image[0].unit", "255"),
        (UPSTREAM, "upstream[0].units[0].as", "71-73"),
        (LINE_C + 'devices = [{ unit = "1-2", as = "61-62" }]\n', "line[1].devices[0].as", "61-62"),
        (LINE_C + 'devices = [{ unit = "61-62" }]\n', "line[1].devices[0].unit", "61-62"),
        (MIRROR.replace("b/17", "a/41").format(200), "image[0].unit", "200"),
    ],
)
def test_a_unit_to_which_nobody_leads(text, place, units):
    assert said(A + LINE_A + text) == [dead(place, units)]
    assert said(SHARED + A + LINE_A + text) == []
    assert said(LINE_A + text) == []


def test_a_panel_and_a_mirror_lead_to_units_too():
    assert said(A + LINE_A + UPSTREAM + PANEL.replace("41", "71")) == [dead("upstream[0].units[0].as", "72-73")]
    panel = PANEL.replace("41", "[200, 71, 73]")
    mirror = MIRROR.replace("b/17", "tcp://10.1.0.5:502/72").format(200)
    assert said(A + LINE_A + UPSTREAM + mirror + panel) == []


def test_nobody_is_blamed_when_a_listener_could_not_be_read():
    (problem,) = said(A + '[[listen]]\nbind = "nowhere"\n' + LINE_A + UPSTREAM)
    assert problem.startswith("error: listen[1].bind")


def test_a_line_whose_listener_could_not_be_read_is_not_blamed():
    (problem,) = said('[[listen]]\nbind = "nowhere"\nline = "b"\n' + LINE_B + LINE_C)
    assert problem.startswith("error: listen[0].bind")


def test_a_line_that_does_not_exist():
    assert said(SHARED + A.replace('"a"', '"aa"') + LINE_A) == [
        'error: listen[1].line: there is no line "aa" | did you mean "a"?'
    ]


def test_lines_that_are_equally_near_are_all_named():
    lines = "".join(line.replace('"a"', '"hall-a"').replace('"c"', '"hall-b"') for line in (LINE_A, LINE_C))
    lines += "devices = [{ unit = 5 }]\n"
    assert said(SHARED + A.replace('"a"', '"hall-x"') + lines) == [
        'error: listen[1].line: there is no line "hall-x" | did you mean "hall-a" or "hall-b"?'
    ]


def test_the_units_of_a_row_for_one_line_are_addresses():
    assert said(SHARED + A + LINE_A + '[[access]]\nlisten = ["port-a"]\nunits = [46]\nallow = ["read"]\n') == [
        (
            "warning: access[0].units: unit 46 is not configured, so the row never matches"
            " | through a listener for one line, units are addresses on its wire: 1-2"
        )
    ]


def test_a_line_where_we_are_a_server():
    assert said(SHARED + A.replace('"a"', '"panel"') + LINE_A + PANEL) == [
        (
            'error: listen[1].line: line "panel" is a server line'
            " | leave line out: every listener leads to the units that it serves"
        )
    ]


@pytest.mark.parametrize(("unit0", "is_there"), [(1, True), (2, True), (41, False), (3, False), (255, False)])
def test_unit0_is_an_address_on_the_line(unit0, is_there):
    problem = f'error: listen[1].unit0: {unit0} is not an address on line "a" | its addresses: 1-2'
    assert said(SHARED + A + f"unit0 = {unit0}\n" + LINE_A) == ([] if is_there else [problem])


def test_every_address_is_on_a_line_without_devices():
    assert said(B + "unit0 = 247\n" + LINE_B) == []


def test_a_line_on_which_no_address_is_known():
    text = A + '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = 0, as = 50 }]\n'
    assert said(text) == [
        (
            'error: listen[0].line: no device of line "a" has an address, so nothing can be asked'
            " | name its address as unit, or leave line out"
        )
    ]


def test_broadcasts_to_a_line_that_takes_none():
    assert said(A + 'unit0 = "broadcast"\n' + LINE_A + "broadcast = false\n") == [
        'warning: listen[0].unit0: line "a" takes no broadcasts | see its key broadcast'
    ]


@pytest.mark.parametrize(
    ("others", "named"),
    [
        (["all"], '"all"'),
        (["panel"], '"panel"'),
        (["control"], '"control"'),
        (["all", "control"], '"all" and "control"'),
    ],
)
def test_a_row_names_listeners_of_one_kind(others, named):
    row = f'[[access]]\nlisten = {json.dumps(["port-a", *others])}\nallow = ["read"]\n'
    what = "names listeners for one line or upstream, under its own numbers"
    assert said(SHARED + A + LINE_A + PANEL + row) == [
        f"error: access[0].listen: {what}, and {named}, where units have others | write a row for each kind"
    ]


def test_a_row_names_any_number_of_listeners_for_one_line():
    assert said(A + B + LINE_A + LINE_B + '[[access]]\nlisten = ["port-a", "port-b"]\nallow = ["read"]\n') == []


@pytest.mark.parametrize(
    ("row", "means"),
    [
        ('listen = ["port-a"]\nunits = 1\n', True),
        ('listen = ["port-a"]\nunits = 41\n', False),
        ('listen = ["all"]\nunits = 41\n', True),
        ('listen = ["all"]\nunits = 1\n', False),
        ("units = 41\n", True),
        ("units = 1\n", False),
    ],
)
def test_the_units_of_a_row_are_addresses_where_it_names_a_listener_for_one_line(row, means):
    found = said(SHARED + A + LINE_A + f'[[access]]\n{row}allow = ["read"]\n')
    assert [each.split(":")[1] for each in found] == ([] if means else [" access[0].units"])


def test_a_line_apart_is_known_by_the_numbers_on_its_wire():
    assert said(SHARED + B + LINE_A + LINE_B + '[[access]]\nunits = 7\nallow = ["read"]\n') == []


def test_a_row_for_units_does_not_cover_one_for_addresses():
    rows = '[[access]]\nunits = 41\nallow = ["read"]\n[[access]]\nlisten = ["port-a"]\nunits = {}\nallow = ["write"]\n'
    text = SHARED + A + LINE_A.replace("41-42", "[2, 41]")
    assert not any("never matches" in each for each in said(text + rows.format(1)))
    every = '[[access]]\nallow = ["read"]\n[[access]]\nlisten = ["port-a"]\nunits = 1\nallow = ["write"]\n'
    assert any("never matches" in each for each in said(text + every))
    twice = '[[access]]\nlisten = ["port-a"]\nunits = "1-2"\nallow = ["read"]\n'
    assert any("never matches" in each for each in said(text + twice + twice.replace("1-2", "1")))


ROOF = LISTEN.format("roof-port", 5023) + 'upstream = "roof"\n'
SERVER = '[[upstream]]\nname = "roof"\nto = "tcp://10.1.0.5"\n'
UNITS = 'units = [{ as = "71-72", unit = [1, 0] }]\n'


@pytest.mark.parametrize("text", [SERVER, SERVER + UNITS, SHARED + SERVER + UNITS, SHARED + SERVER + A + LINE_A])
def test_an_upstream_with_a_listener_of_its_own_needs_no_units(text):
    assert said(ROOF + text) == []


def test_an_upstream_without_units_needs_a_listener_of_its_own():
    what = "error: upstream[0]: units is missing"
    remedy = 'name its units, or give it its own [[listen]] with upstream = "roof"'
    assert said(SHARED + SERVER) == [f"{what} | {remedy}"]
    (problem,) = said('[[listen]]\nbind = "nowhere"\nupstream = "roof"\n' + SERVER)
    assert problem.startswith("error: listen[0].bind")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            ROOF.replace('"roof"', '"rof"') + SERVER + UNITS,
            'upstream: there is no upstream "rof" | did you mean "roof"?',
        ),
        (ROOF.replace('"roof"', '"a"') + LINE_A, 'upstream: there is no upstream "a" | write line = "a"'),
        (
            ROOF.replace("upstream = ", "line = ") + SERVER + UNITS,
            'line: there is no line "roof" | write upstream = "roof"',
        ),
        (
            ROOF + 'line = "a"\n' + LINE_A + SERVER,
            "upstream: cannot be combined with line | take one of them out, and write a [[listen]] for each",
        ),
        (
            ROOF + 'unit0 = "refuse"\n' + SERVER,
            "unit0: unit 0 is a unit of that server here, with a response | take it out",
        ),
    ],
)
def test_what_does_not_fit_a_listener_for_one_upstream(text, problem):
    assert [each for each in said(text) if "listen" in each.split(":")[1]] == [f"error: listen[0].{problem}"]


def test_an_upstream_that_could_not_be_read_is_not_missed():
    (problem,) = said(SHARED + ROOF + SERVER + UNITS + "in_flight = 0\n")
    assert problem.startswith("error: upstream[0].in_flight")


def test_units_of_an_upstream_are_reached_through_its_own_listener():
    assert said(ROOF + SERVER + UNITS) == []
    assert said(A + LINE_A + SERVER + UNITS) == [dead("upstream[0].units[0].as", "71-72")]


ROW = '[[access]]\nlisten = ["{}"]\nunits = {}\nallow = ["read"]\n'


@pytest.mark.parametrize("units", ["0", "255", '[0, "248-254"]', '"1-247"'])
def test_a_row_for_an_upstream_counts_by_the_units_of_the_server(units):
    assert said(SHARED + ROOF + SERVER + UNITS + ROW.format("roof-port", units)) == []


def test_clients_of_other_listeners_have_no_unit_0():
    strange = "error: access[0].units: unit 0 is outside 1-255"
    assert said(SHARED + ROOF + SERVER + UNITS + ROW.format("all", "[0, 71]")) == [strange]
    by_anyone = '[[access]]\nunits = [0, 71]\nallow = ["read"]\n'
    assert said(SHARED + ROOF + SERVER + UNITS + by_anyone) == [strange]


def test_a_row_for_a_listener_that_could_not_be_read_is_not_blamed():
    (problem,) = said(SHARED + ROOF + "clients = 0\n" + SERVER + UNITS + ROW.format("roof-port", "[0, 250]"))
    assert problem.startswith("error: listen[1].clients")


def test_a_row_may_name_listeners_for_lines_and_upstreams():
    row = '[[access]]\nlisten = ["port-a", "roof-port"]\nunits = 1\nallow = ["read"]\n'
    assert said(SHARED + A + ROOF + LINE_A + SERVER + row) == []


def test_what_units_without_a_number_are_called_is_the_name_of_nothing_else():
    image = '[[image]]\nunit = 200\nname = "{}"\nholding = 1\n'
    for taken in ("roof/9", "roof/unit-71"):
        (problem,) = said(SHARED + ROOF + SERVER + UNITS + image.format(taken))
        assert problem.startswith(f'error: image[0].name: "{taken}"')
        assert said(SHARED + SERVER + UNITS + image.format(taken)) == []
