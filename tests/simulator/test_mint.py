"""The Mint controller: its functions, locations, exceptions, broadcasts and answer times."""

import pytest

from gateway.simulator.mint import Mint
from simulator.playing import arrivals, ascii_frame, ascii_line, ask, write

CHARACTER = 10 / 19200


def exchange(pdu: str, *, line=None, unit: int = 2, at: float = 0.0) -> str | None:
    """The response PDU, in hexadecimal digits; None for silence."""
    data = ask(line or ascii_line(Mint(2)), ascii_frame(unit, pdu), at=at, baud=19200)
    return data[3:-4].decode() or None


@pytest.mark.parametrize(
    ("pdu", "expected"),
    [
        ("04 0001 0001", "8401"),
        ("06 0001 0001", "8601"),
        ("0F 0000 0001 01 01", "8F01"),
        ("16 0001 FFFF 0000", "9601"),
        ("2B 0E 01 00", "AB01"),
    ],
)
def test_other_functions_are_illegal(pdu, expected):
    assert exchange(pdu) == expected


@pytest.mark.parametrize(
    "pdu",
    [
        "03 0000 0001",
        "03 0063 0002",
        "03 0001 0064",
        "10 0000 0001 02 0000",
        "17 0000 0001 0001 0001 02 0000",
        "01 0010 0001",
        "02 0000 0011",
        "05 0010 FF00",
    ],
)
def test_locations_and_outputs_outside_are_illegal_addresses(pdu):
    assert exchange(pdu) == f"{int(pdu[:2], 16) | 0x80:02X}02"


def test_all_99_locations_can_be_read_at_once():
    assert exchange("03 0001 0063") == "03C6" + "0000" * 99


def test_an_output_that_is_neither_on_nor_off_is_refused_and_stays_as_it_was():
    line = ascii_line(Mint(2))
    assert exchange("05 0003 FF00", line=line) == "050003FF00"
    assert exchange("05 0003 FF01", line=line, at=1.0) == "8503"
    assert exchange("01 0000 0010", line=line, at=2.0) == "01020800"


def test_23_writes_and_reads_in_one_go():
    assert exchange("17 0005 0002 0006 0001 02 1234") == "170400001234"


@pytest.mark.parametrize(
    ("broadcast", "read", "expected"),
    [("05 0000 FF00", "01 0000 0001", "010101"), ("10 0001 0001 02 0007", "03 0001 0001", "03020007")],
)
def test_broadcasts_of_05_and_16_are_acted_on_and_not_answered(broadcast, read, expected):
    line = ascii_line(Mint(2))
    assert exchange(broadcast, line=line, unit=0) is None
    assert exchange(read, line=line, at=1.0) == expected


def test_other_broadcasts_are_ignored():
    line = ascii_line(Mint(2))
    assert exchange("17 0001 0001 0001 0001 02 0007", line=line, unit=0) is None
    assert exchange("03 0001 0001", line=line, unit=0, at=1.0) is None
    assert exchange("03 0001 0001", line=line, at=2.0) == "03020000"


@pytest.mark.parametrize(
    ("pdu", "milliseconds"),
    [
        ("01 0000 0001", 10),
        ("01 0000 0010", 10),
        ("02 0000 0010", 10),
        ("03 0001 0001", 10),
        ("03 0001 0032", 215),
        ("03 0001 0063", 420),
        ("05 0000 FF00", 10),
        ("10 0001 0001 02 0000", 10),
        ("10 0001 0063 C6" + " 0000" * 99, 240),
        ("17 0001 0001 0001 0001 02 0000", 14),
        ("17 0001 0063 0001 0063 C6" + " 0000" * 99, 500),
        ("04 0001 0001", 10),
    ],
)
def test_it_answers_after_the_time_that_its_table_says(pdu, milliseconds):
    line, request = ascii_line(Mint(2)), ascii_frame(2, pdu)
    write(line, request, baud=19200)
    first_two = arrivals(line)[0].at
    assert first_two - (len(request) + 2) * CHARACTER == pytest.approx(milliseconds / 1000)
