"""The V80 controller beyond its printed examples: sizes, functions, broadcasts, both modes."""

import pytest

from gateway.simulator.v80 import V80
from simulator.playing import ascii_frame, ascii_line, ask, rtu_frame, rtu_line


def exchange(pdu: str, *, line=None, unit: int = 17, at: float = 0.0) -> str | None:
    """The response PDU, in hexadecimal digits; None for silence."""
    data = ask(line or rtu_line(V80(17)), rtu_frame(unit, pdu), at=at)
    return data[1:-2].hex() or None


def test_1024_coils_can_be_read_at_once():
    response = exchange("01 0000 0400")
    assert response is not None
    assert response.startswith("0180")


@pytest.mark.parametrize(
    ("pdu", "expected"),
    [
        ("01 0000 0401", "8103"),
        ("01 0001 0400", "8102"),
        ("03 0000 007E", "8303"),
        ("03 03FF 0002", "8302"),
        ("05 00AC 0001", "8503"),
        ("16 0000 FFFF 0000", "9601"),
        ("17 0000 0001 0000 0001 02 0000", "9701"),
    ],
)
def test_what_it_refuses(pdu, expected):
    assert exchange(pdu) == expected


@pytest.mark.parametrize(
    ("broadcast", "read", "expected"),
    [
        ("05 0000 FF00", "01 0000 0001", "010101"),
        ("06 0000 0007", "03 0000 0001", "03020007"),
        ("0F 0000 0002 01 03", "01 0000 0002", "010103"),
        ("10 0000 0001 02 0007", "03 0000 0001", "03020007"),
    ],
)
def test_broadcasts_are_acted_on_and_not_answered(broadcast, read, expected):
    line = rtu_line(V80(17))
    assert exchange(broadcast, line=line, unit=0) is None
    assert exchange(read, line=line, at=1.0) == expected


def test_it_speaks_ascii_too():
    answer = ask(ascii_line(V80(17)), ascii_frame(17, "03 006B 0003"))
    assert answer == ascii_frame(17, "03 06 022B 0000 0064")
