"""The generic device: a hundred of everything, ten functions, nothing else."""

import pytest

from gateway.simulator.generic import Generic
from kit.vectors import exchanges, meaning
from simulator.playing import ask, rtu_frame, rtu_line


def exchange(pdu: str) -> str:
    return ask(rtu_line(Generic(1)), rtu_frame(1, pdu))[1:-2].hex()


@pytest.mark.parametrize("vector", [one for one in exchanges() if one.reads or one.writes], ids=meaning)
def test_it_has_all_functions(vector):
    """Each is either performed or refused for its addresses, never for its function."""
    response = exchange(vector.request.pdu.hex())
    assert response[2:] != "01" or response[0] < "8"


@pytest.mark.parametrize(
    ("pdu", "expected"),
    [
        ("03 0063 0001", "03020000"),
        ("03 0064 0001", "8302"),
        ("01 0000 0065", "8102"),
        ("2B 0E 01 00", "ab01"),
        ("41", "c101"),
        ("03 0000 0000", "8303"),
    ],
)
def test_its_bounds(pdu, expected):
    assert exchange(pdu) == expected
