"""Who may do what: rows, doors, and what becomes of both."""

from ipaddress import ip_network
from typing import Literal

import pytest

from gateway.modbus.functions import only_reads
from gateway.routing.access import (
    AS_NUMBERED,
    DEFAULT_ROWS,
    EVERYTHING,
    NOTHING,
    READING,
    WRITING,
    AccessRow,
    EntryPoint,
    Right,
    right_to,
)
from gateway.routing.rights import MOST_CLIENTS, Rights

SCADA = EntryPoint("scada")
PANEL = EntryPoint("panel", "local")
FIELD = EntryPoint("field", "datagram")
ANYWHERE = "10.9.9.9"


def row(right: Right = EVERYTHING, source: str = "", *, listen: str = "", units: str = "") -> AccessRow:
    return AccessRow(
        right,
        (ip_network(source),) if source else None,
        frozenset([listen]) if listen else None,
        frozenset(map(int, units.split())) if units else None,
    )


def allows(right: Right, pdu: str) -> bool:
    """As the router reads a right."""
    data = bytes.fromhex(pdu)
    return data[0] in right or data[:1] in right or data[:2] in right


@pytest.mark.parametrize("function", range(256))
def test_every_function_reads_or_writes_and_43_depends_on_what_follows(function: int) -> None:
    reads = function in (1, 2, 3, 4, 7, 11, 12, 17, 20, 24)
    pdu = f"{function:02X} 00 00 00 01"
    assert only_reads(bytes.fromhex(pdu)) is reads
    assert allows(READING, pdu) is reads
    assert allows(WRITING, pdu) is not reads
    assert allows(EVERYTHING, pdu)
    assert not allows(NOTHING, pdu)
    assert allows(right_to([3, function]), pdu)
    assert allows(right_to([3, 16]), pdu) is (function in (3, 16))


def test_what_a_device_is_may_be_read() -> None:
    assert only_reads(b"\x2b\x0e\x01\x00")
    assert allows(READING, "2B 0E 01 00")
    assert not allows(READING, "2B 0D 01 00")
    assert allows(right_to([43]), "2B 0E 01 00")


@pytest.mark.parametrize(
    ("host", "right"),
    [
        ("127.0.0.1", EVERYTHING),
        ("127.8.9.1", EVERYTHING),
        ("::1", EVERYTHING),
        ("::ffff:127.0.0.1", EVERYTHING),
        ("10.0.0.9", READING),
        ("::ffff:10.0.0.9", READING),
        ("fe80::1%eth0", READING),
    ],
)
def test_without_a_table_clients_of_this_machine_do_everything_and_others_read(host: str, right: Right) -> None:
    assert set(Rights(DEFAULT_ROWS, SCADA)[host]) == {right}


def test_without_a_table_datagrams_read_and_cables_do_everything() -> None:
    assert set(Rights(DEFAULT_ROWS, FIELD)["127.0.0.1"]) == {READING}
    assert set(Rights(DEFAULT_ROWS, PANEL)[""]) == {EVERYTHING}


def test_the_first_row_that_means_client_and_unit_counts() -> None:
    table = [row(NOTHING, "10.2.0.66"), row(READING, "10.2.0.0/24", units="1 2"), row(EVERYTHING, "10.0.0.0/8")]
    rights = Rights(table, SCADA)
    assert set(rights["10.2.0.66"]) == {NOTHING}
    assert [rights["10.2.0.7"][unit] for unit in (1, 2, 3, 247)] == [READING, READING, EVERYTHING, EVERYTHING]
    assert set(rights["10.3.0.7"]) == {EVERYTHING}
    assert set(rights["192.168.1.1"]) == {NOTHING}


@pytest.mark.parametrize("host", ["10.2.0.7", "::ffff:10.2.0.7", "fe80::7%eth0"])
def test_networks_of_both_kinds(host: str) -> None:
    table = [AccessRow(READING, (ip_network("10.2.0.0/24"), ip_network("fe80::/10")))]
    assert set(Rights(table, SCADA)[host]) == {READING}


def test_a_row_for_another_listener_means_nobody_here() -> None:
    table = [row(EVERYTHING, listen="office"), row(READING)]
    assert set(Rights(table, SCADA)[ANYWHERE]) == {READING}
    assert set(Rights(table, EntryPoint("office"))[ANYWHERE]) == {EVERYTHING}


def test_who_may_do_nothing_anywhere_is_not_admitted() -> None:
    table = [row(NOTHING, "10.2.0.66"), row(READING, "10.2.0.0/24", units="5")]
    rights = Rights(table, SCADA)
    assert [host for host in ("10.2.0.66", "10.2.0.7", "10.3.0.7", "::1") if rights.admits(host)] == ["10.2.0.7"]


def test_an_address_is_named_when_a_row_that_counts_here_gives_rights_to_its_network() -> None:
    rows = [
        row(NOTHING, "10.2.0.66"),
        row(READING, "10.2.0.0/24", units="7"),
        row(READING, "10.3.0.0/24", listen="panel"),
        row(READING),
    ]
    rights = Rights(rows, SCADA)
    hosts = ("10.2.0.7", "10.3.0.7", "10.4.0.7", "::ffff:10.2.0.9")
    assert [host for host in hosts * 2 if rights.names(host)] == 2 * ["10.2.0.7", "::ffff:10.2.0.9"]
    assert all(map(rights.admits, hosts))
    for number in range(2 * MOST_CLIENTS):
        rights.names(f"10.2.0.{number % 250}" if number % 2 else f"10.9.{number // 250}.{number % 250}")
    assert len(rights._named) <= MOST_CLIENTS


def test_datagrams_only_read_by_rows_that_do_not_name_their_listener() -> None:
    table = [row(right_to([3, 16]), "10.2.0.0/24"), row(EVERYTHING, "10.0.0.0/8", listen="field"), row(EVERYTHING)]
    rights = Rights(table, FIELD)
    assert set(rights["10.2.0.7"]) == {right_to([3])}
    assert set(rights["10.3.0.7"]) == {EVERYTHING}
    assert set(rights["192.168.1.1"]) == {READING}


def test_datagrams_read_what_a_device_is_by_the_right_to_43() -> None:
    (right,) = set(Rights([row(right_to([3, 43]))], FIELD)[ANYWHERE])
    assert [allows(right, pdu) for pdu in ("2B 0E 01 00", "2B 0D 01 00", "03 0000 0001")] == [True, False, True]


@pytest.mark.parametrize(
    ("table", "right"),
    [
        ([row(READING)], EVERYTHING),
        ([row(READING, "10.0.0.0/8"), row(NOTHING, listen="scada")], EVERYTHING),
        ([row(READING, listen="panel")], READING),
        ([row(NOTHING, units="7"), row(READING, listen="panel", units="1")], NOTHING),
        ([row(READING, "0.0.0.0/0", listen="panel"), row(EVERYTHING, "::/0")], NOTHING),
    ],
)
def test_a_cable_keeps_its_rights_until_a_row_names_it(table: list[AccessRow], right: Right) -> None:
    assert Rights(table, PANEL)[""][7] == right


@pytest.mark.parametrize("kind", ["connection", "local"])
def test_all_units_at_once_need_the_right_at_each_of_them(kind: Literal["connection", "local"]) -> None:
    entry = EntryPoint("scada", kind)
    everywhere = row(EVERYTHING, listen="scada")
    assert Rights([everywhere], entry)[""][0] == EVERYTHING
    assert Rights([row(READING, units="7"), everywhere], entry)[""][0] == READING
    assert Rights([row(EVERYTHING, listen="scada", units="7")], entry)[""][0] == NOTHING


def test_that_is_so_too_for_a_unit_with_another_number_here() -> None:
    """Unit 3 is known as 250."""
    known_as = tuple((3,) if unit == 250 else () if unit == 3 else here for unit, here in enumerate(AS_NUMBERED))
    rights = Rights([row(READING, units="3"), row(EVERYTHING)], SCADA, known_as)[ANYWHERE]
    assert (rights[3], rights[250], rights[0]) == (EVERYTHING, READING, READING)


def test_and_for_units_that_nobody_else_has() -> None:
    rights = Rights([row(READING, listen="scada", units="3"), row(EVERYTHING)], SCADA, ((),) * 256)[ANYWHERE]
    assert (rights[3], rights[4], rights[0]) == (READING, EVERYTHING, READING)


@pytest.mark.parametrize(("unit", "right"), [(7, READING), (8, EVERYTHING)])
def test_unit_0_in_the_place_of_another_unit_has_the_rights_at_that_one(unit: int, right: Right) -> None:
    rights = Rights([row(READING, units="7"), row(EVERYTHING)], EntryPoint("scada", unit0=unit))[ANYWHERE]
    assert rights[0] == rights[unit] == right


def test_the_rights_of_many_clients_are_not_all_remembered() -> None:
    rights = Rights(DEFAULT_ROWS, SCADA)
    for number in range(MOST_CLIENTS + 10):
        assert set(rights[f"10.1.{number // 256}.{number % 256}"]) == {READING}
    assert len(rights) == 10


def rights_of_sites(*rows):
    return Rights(rows, EntryPoint("fleet", "site"))


def test_other_sites_only_read_until_a_row_names_them():
    rights = rights_of_sites(AccessRow(EVERYTHING), AccessRow(NOTHING, units=frozenset({5})))
    assert rights["plant-1"][5] == READING


def test_a_row_without_a_listener_lets_other_sites_read_only():
    rights = rights_of_sites(
        AccessRow(NOTHING, listeners=frozenset({"fleet"}), units=frozenset({1})), AccessRow(EVERYTHING)
    )
    assert (rights["plant-1"][1], rights["plant-1"][5]) == (NOTHING, READING)


def test_a_row_for_a_site_is_for_no_other():
    named = AccessRow(EVERYTHING, networks=(), listeners=frozenset({"fleet"}), sites=frozenset({"plant-1"}))
    rights = rights_of_sites(named)
    assert (rights["plant-1"][5], rights["plant-10"][5], rights["10.2.0.7"][5]) == (EVERYTHING, NOTHING, NOTHING)


def test_a_row_for_sites_is_for_no_address():
    named = AccessRow(EVERYTHING, networks=(), sites=frozenset({"10.2.0.7"}))
    assert Rights((named,), EntryPoint("scada"))["10.2.0.7"][5] == NOTHING
