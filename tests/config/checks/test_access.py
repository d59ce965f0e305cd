"""Who may do what: each rule with a file that breaks it."""

import pytest

from gateway.config.checks import access as check_access_module
from gateway.config.load import parse
from gateway.config.problem import dotted

UNITS = "[[image]]\nunit = 7\ncoils = 1\n[[image]]\nunit = 8\ncoils = 1\n"
SCADA = '[[listen]]\nname = "scada"\nbind = "tcp://0.0.0.0:502"\n'
EVERYWHERE = '[[listen]]\nname = "scada"\nbind = "tcp://[::]:502"\n'
FIELD = '[[listen]]\nname = "field"\nbind = "udp://127.0.0.1:502"\n'
PANEL = '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\nserves = 7\n'
READ = 'allow = ["read"]\n'


def problems(text):
    found = parse(UNITS + text, "gateway.toml", port_trouble=lambda _: None, real_path=str).problems
    return [
        f"{one.severity}: {dotted(one.path)}: {one.what}" + (f" | {one.remedy}" if one.remedy else "") for one in found
    ]


def access(*rows, listen=SCADA):
    return problems(listen + "".join(f"[[access]]\n{row}" + ("" if "allow" in row else READ) for row in rows))


# Without any row


@pytest.mark.parametrize(
    ("listen", "what", "row"),
    [
        (
            FIELD,
            "UDP clients may only read without [[access]]: a datagram can name any address as its sender",
            'listen = ["field"]',
        ),
        (
            SCADA,
            "clients from other machines may only read without [[access]]",
            'from = ["10.2.0.0/24", "127.0.0.0/8"]',
        ),
        (
            SCADA.replace("0.0.0.0", "[::]"),
            "clients from other machines may only read without [[access]]",
            'from = ["10.2.0.0/24", "127.0.0.0/8", "::1"]',
        ),
    ],
)
def test_who_may_only_read_is_told_and_how_that_is_changed(listen, what, row):
    remedy = f'to let them write, add [[access]] with {row} and allow = ["read", "write"]'
    after = '. Then add a last row allow = ["read"]: clients that match no row are refused'
    assert problems(listen) == [f"warning: listen[0].bind: {what} | {remedy}{after}"]


def test_a_listener_for_this_machine_needs_no_rights():
    assert problems('[[listen]]\nbind = "tcp://127.0.0.1:502"\n') == []


@pytest.mark.parametrize("row", [READ, 'allow = "read"\n'])
def test_who_has_written_rights_is_not_told_about_them(row):
    assert not [said for said in problems(SCADA + "[[access]]\n" + row) if "may only read" in said]


# Rows


@pytest.mark.parametrize("row", ["allow = []\n", 'allow = ["read", "write"]\n', "functions = [3, 16]\n"])
def test_a_row_allows_rights_or_functions_or_nothing(row):
    assert problems(SCADA + "[[access]]\n" + row) == []


@pytest.mark.parametrize(("key", "row"), [("allow", 'allow = ["write"]\n'), ("functions", "functions = [6, 16]\n")])
def test_rows_that_let_nobody_read_are_worth_a_look(key, row):
    what = "no row of [[access]] lets a client read: clients that match no row are refused"
    remedy = 'allow = ["read", "write"], or a last row allow = ["read"]'
    text = SCADA + "[[access]]\nallow = []\nunits = 8\n[[access]]\n" + row
    assert problems(text) == [f"warning: access[1].{key}: {what} | {remedy}"]
    assert problems(f"{text}[[access]]\nfrom = ['10.2.0.0/24']\nallow = []\n")[:1] == problems(text)
    assert problems(f"{SCADA}[[access]]\nunits = 8\n{row}[[access]]\n{READ}") == []


def test_rows_for_the_control_socket_alone_leave_other_clients_nothing():
    control = 'listen = ["control"]\nallow = ["read", "write"]\n'
    what = "no row of [[access]] is for a [[listen]]: all clients that connect there are refused"
    assert access(control) == [f'warning: access[0].listen: {what} | add a last row allow = ["read"]']
    assert access(control, READ) == []
    assert access('listen = ["control"]\nallow = []\n') == []


@pytest.mark.parametrize("row", ["", 'allow = ["read"]\nfunctions = [3]\n'])
def test_a_row_says_in_one_way_what_it_allows(row):
    remedy = 'such as allow = ["read", "write"]; allow = [] refuses everything'
    assert problems(SCADA + "[[access]]\n" + row) == [
        f"error: access[0]: must have one of allow and functions | {remedy}"
    ]


@pytest.mark.parametrize("key", ["from", "listen"])
def test_an_empty_list_means_nobody(key):
    assert access(f"{key} = []\n") == [
        f"error: access[0].{key}: is empty, so the row matches no client | leave it out to match all clients"
    ]


def test_a_row_names_listeners_server_lines_and_the_control_socket():
    assert access('listen = ["scada", "panel", "control"]\n', listen=SCADA + PANEL) == []
    assert access('listen = ["default"]\n', listen="") == []


def test_a_row_for_an_unknown_listener():
    said = 'error: access[0].listen[1]: there is no listener "skada" | did you mean "scada"?'
    assert access('listen = ["control", "skada"]\n') == [said]


def test_a_row_for_a_listener_that_failed():
    assert access('listen = ["scada"]\n', listen='[[listen]]\nname = "scada"\n') == [
        "error: listen[0].bind: bind is missing"
    ]


def test_who_is_on_a_cable_has_no_network():
    for name in "panel", "control", "mqtt", "embedded":
        what = f'clients of "{name}" have no network, so a row with from never matches them'
        assert access(f'listen = ["scada", "{name}"]\nfrom = ["10.2.0.0/24"]\n', listen=SCADA + PANEL) == [
            f"warning: access[0].listen[1]: {what} | name it in a row of its own, without from"
        ]


# Networks


@pytest.mark.parametrize(
    ("bind", "network", "why"),
    [
        ("tcp://0.0.0.0:1", "10.2.0.0/24", ""),
        ("tcp://0.0.0.0:1", "fe80::/10", "scada takes IPv4 clients only (tcp://0.0.0.0:1)"),
        ("tcp://[fd00::1]:1", "10.2.0.0/24", "scada takes IPv6 clients only (tcp://[fd00::1]:1)"),
        ("tcp://[fd00::1]:1", "fd00::/8", ""),
        ("tcp://[::]:1", "10.2.0.0/24", ""),
        ("tcp://[::]:1", "fd00::/8", ""),
        ("tcp://plc.example:1", "10.2.0.0/24", ""),
        ("tcp://127.0.0.1:1", "10.2.0.0/24", "scada is for programs on this machine (tcp://127.0.0.1:1)"),
        ("tcp://127.0.0.1:1", "127.0.0.2", ""),
        ("tcp://127.0.0.1:1", "0.0.0.0/0", ""),
        ("tcp://localhost:1", "::1", ""),
    ],
)
def test_a_network_from_which_nobody_comes(bind, network, why):
    said = access(f'from = ["{network}"]\n', listen=f'[[listen]]\nname = "scada"\nbind = "{bind}"\n')
    assert said == ([f"warning: access[0].from[0]: no client can connect from {network}: {why}"] if why else [])


def test_without_a_listener_clients_come_from_this_machine_only():
    why = "default is for programs on this machine (tcp://127.0.0.1:5020)"
    said = [f"warning: access[0].from[1]: no client can connect from 10.2.0.0/24: {why}"]
    assert access('from = ["127.0.0.1", "10.2.0.0/24"]\n', listen="") == said


def test_ipv4_clients_go_where_an_ipv4_address_is():
    both = '[[listen]]\nname = "six"\nbind = "tcp://[::]:5020"\n' + SCADA.replace(
        "tcp://0.0.0.0:502", "tcp://0.0.0.0:5020"
    )
    assert access('from = ["10.2.0.0/24"]\n', listen=both) == []
    assert access('from = ["10.2.0.0/24"]\nlisten = ["six"]\n', listen=both) == [
        "warning: access[0].from[0]: no client can connect from 10.2.0.0/24: six takes IPv6 clients only (tcp://[::]:5020)"
    ]


# Units, and the order of rows


def test_a_row_for_units_that_nobody_answers_for():
    assert access('units = ["1-3", 5]\n') == [
        "warning: access[0].units: units 1-3, 5 are not configured, so the row never matches"
    ]
    assert access("units = [1, 7]\n") == []


@pytest.mark.parametrize(
    ("earlier", "row"),
    [
        ("", 'from = ["10.2.0.0/24"]\n'),
        ("", 'listen = ["scada"]\nunits = 7\n'),
        ("units = [7, 8]\n", "units = 7\n"),
        ('listen = ["scada", "panel"]\n', 'listen = ["panel"]\n'),
        ('from = ["10.0.0.0/8", "fd00::/8"]\n', 'from = ["10.2.0.0/24", "10.3.0.1"]\n'),
    ],
)
def test_a_row_that_an_earlier_one_hides(earlier, row):
    (said,) = access(earlier, row, listen=SCADA.replace("0.0.0.0", "[::]") + PANEL)
    what = "never matches, because the row in gateway.toml:15 matches all that it would match"
    assert said == f"warning: access[1]: {what} | first match wins: put the special row before the general one"


def test_of_several_rows_that_hide_another_the_first_is_named():
    rows = ['from = ["10.2.0.0/24"]\n', 'from = ["10.0.0.0/8"]\n', "", 'from = ["10.2.0.7"]\n']
    for order in ((0, 1, 2, 3), (1, 2, 3), (2, 3)):
        said = access(*(rows[each] for each in order))[-1]
        assert said.startswith(f"warning: access[{len(order) - 1}]: never matches, because the row in gateway.toml:10 ")


def test_a_row_for_sites_that_an_earlier_one_hides():
    named = ('["plant-2", "plant-1"]', '["plant-1"]', '["plant-3"]')
    said = access(*(f'listen = ["fleet"]\nfrom = {sites}\n' for sites in named))
    assert [each.split(": ")[1] for each in said if "never matches" in each] == ["access[1]"]


def test_rows_for_other_clients_are_not_compared(monkeypatch):
    """Else thousands of them, one for each client, take longer than a reload may."""
    compared, covers = [], check_access_module._covers

    def count(earlier, row, **rest):
        compared.append(row)
        return covers(earlier, row, **rest)

    monkeypatch.setattr(check_access_module, "_covers", count)
    clients = [f"10.2.{number}.7" for number in range(200)] + [f"fd00::{number}" for number in range(200)]
    said = access(*(f'from = ["{client}"]\n' for client in clients), 'from = ["10.2.9.7"]\n', listen=EVERYWHERE)
    assert [each.split(": ")[1] for each in said if "never matches" in each] == ["access[400]"]
    assert len(compared) == 1


@pytest.mark.parametrize(
    ("earlier", "row"),
    [
        ('from = ["10.2.0.0/24"]\n', ""),
        ('from = ["10.2.0.0/24"]\n', 'from = ["10.0.0.0/8"]\n'),
        ('from = ["10.2.0.0/24"]\n', 'from = ["10.2.0.0/24", "10.3.0.0/24"]\n'),
        ('from = ["10.0.0.0/8"]\n', 'from = ["fd00::/8"]\n'),
        ("units = 7\n", "units = [7, 8]\n"),
        ("units = 7\n", ""),
        ('listen = ["scada"]\n', ""),
        ('listen = ["scada"]\n', 'listen = ["scada", "panel"]\n'),
    ],
)
def test_a_row_that_means_more_than_the_earlier_one_counts(earlier, row):
    assert access(earlier, row, listen=SCADA.replace("0.0.0.0", "[::]") + PANEL) == []


# Addresses


@pytest.mark.parametrize(
    ("earlier", "row"),
    [
        ('holding = "0-99"\n', 'holding = "10-0x10"\n'),
        ('holding = "0-99"\nunits = [7, 8]\n', 'holding = ["1", "90-99"]\nunits = 7\n'),
        ("", 'coils = "0-9"\n'),
        ('holding = ["0-49", "50-99"]\ncoils = "4"\n', 'holding = "40-60"\n'),
    ],
)
def test_a_row_for_addresses_that_an_earlier_one_hides(earlier, row):
    (said,) = access(earlier, row)
    assert said.startswith("warning: access[1]: never matches, because the row in gateway.toml:10 ")


@pytest.mark.parametrize(
    ("earlier", "row"),
    [
        ('holding = "0-99"\n', ""),
        ('holding = "0-99"\n', 'holding = "90-100"\n'),
        ('holding = "0-99"\n', 'coils = "0-9"\n'),
        ('holding = "0-99"\n', 'holding = "0-9"\ncoils = "0-9"\n'),
        ('holding = "0-99"\nunits = 7\n', 'holding = "0-9"\n'),
    ],
)
def test_a_row_for_other_addresses_counts(earlier, row):
    assert access(earlier, row) == []


def test_a_row_is_for_some_address():
    said = 'error: access[0].holding: names no address | write a range such as "0-99", or leave the key out'
    assert access("holding = 0\n") == [said]
    assert access('coils = "1"\nholding = []\n') == [said]


def test_a_number_alone_could_be_a_count_or_an_address():
    """It is a count elsewhere, and `units = 40` is a unit: to guess wrong gives rights away."""
    assert access("holding = 40\n") == [
        'error: access[0].holding: could be a count or an address | write "0-39", or "40" for one address'
    ]


@pytest.mark.parametrize(
    ("row", "key", "areas"),
    [
        ('coils = "0-9"\nfunctions = [3, 43]\n', "functions", "coils"),
        ('input = "0-9"\ndiscrete = "7"\nallow = ["write"]\n', "allow", "discrete or input"),
    ],
)
def test_a_row_allows_something_that_there_is_at_its_addresses(row, key, areas):
    what = f"nothing of this is for {areas}, so the row refuses everything at its addresses"
    last = "[[access]]\n" + READ
    assert problems(f"{SCADA}[[access]]\n{row}{last}") == [
        f"warning: access[0].{key}: {what} | write allow = [] if that is meant"
    ]
    assert problems(f'{SCADA}[[access]]\ncoils = "0-9"\nallow = []\n{last}') == []
    assert problems(f'{SCADA}[[access]]\ncoils = "0-9"\nfunctions = [3, 15]\n{last}') == []


@pytest.mark.parametrize(
    ("key", "why"),
    [
        ('holding = "9-1"', 'access[0].holding: "9-1" counts backwards | write "1-9"'),
        ('coils = "65530-65536"', "access[0].coils: address 65536 is above 65535"),
        ('priority = "low"', 'access[0].priority: must be "normal" or "high"'),
    ],
)
def test_addresses_and_priority_are_written_as_elsewhere(key, why):
    (said,) = access(key + "\n")
    assert said.startswith(f"error: {why}")


# Places that are kept

NAMED = 'from = ["10.2.0.0/24"]\n'
FULL = "clients = 8\nreserve = 8\n"
SOME = "clients = 8\nreserve = 7\n"


def test_a_reserve_leaves_places_for_others():
    what = "error: listen[0].reserve: leaves no connection for clients that no row of [[access]] names"
    assert access(NAMED, listen=SCADA + FULL) == [f"{what} | make clients larger, or reserve less than 8"]
    assert access(NAMED, listen=SCADA + SOME) == []


@pytest.mark.parametrize("row", ["", 'listen = ["field"]\n' + NAMED, NAMED + "allow = []\n"])
def test_a_reserve_is_for_somebody(row):
    what = "warning: listen[0].reserve: reserves connections, but no row of [[access]] gives an address any right"
    remedy = 'name them in a row: from = ["10.2.0.7"]'
    assert f"{what} | {remedy}" in access(row, listen=SCADA + SOME + FIELD)


def test_without_rows_a_reserve_is_for_this_machine():
    assert not any("reserve" in one for one in problems(SCADA + SOME))


@pytest.mark.parametrize("units", ["[1]", "[1, 2]"])
def test_a_row_by_unit_ids_does_not_count_for_devices_without_them(units):
    parts = (
        f'[[listen]]\nname = "to-{name}"\nbind = "tcp://127.0.0.1:150{number}"\nline = "{name}"\n'
        f'[[line]]\nname = "{name}"\nport = "/dev/ttyS{number}"\n'
        f'devices = [{{ unit = 1, as = "none" }}, {{ unit = {number} }}]\n'
        for name, number in (("a", 2), ("b", 3))
    )
    text = "".join(parts) + f'[[access]]\nunits = {units}\nallow = ["read"]\n[[access]]\nallow = ["read", "write"]\n'
    found = [each for each in parse(text, port_trouble=lambda port: None).problems if "access" in each.path]
    assert [(each.severity, each.what) for each in found] == [
        ("warning", "devices at 1 have no unit ID for clients, so the row does not count for them")
    ]
