"""The weighing transducer: weight, zero, address, rate, and what it refuses."""

from struct import pack, unpack

import pytest

from gateway.simulator.weigher import PRINTED_WEIGHT, Weigher
from simulator.playing import arrivals, ask, rtu_frame, rtu_line, write

READ_WEIGHT = "03 0000 0002"
TAKE_ZERO = "10 1A00 0001 02 00BB"
BECOME_5 = "10 0100 0001 02 0005"


def set_baud(baud: float) -> str:
    return "10 0200 0002 04" + pack(">f", baud).hex()


def exchange(line, pdu: str, *, unit: int = 1, at: float = 0.0, baud: int = 9600) -> str | None:
    """The response's unit and PDU, in hexadecimal digits; None for silence."""
    data = ask(line, rtu_frame(unit, pdu), at=at, baud=baud)
    return data[:-2].hex() or None


def weight(line, at: float) -> float:
    response = exchange(line, READ_WEIGHT, at=at)
    assert response is not None
    return unpack(">f", bytes.fromhex(response)[3:])[0]


def test_the_printed_weight():
    assert pack(">f", PRINTED_WEIGHT).hex(" ").upper() == "45 9C 3D 51"
    assert weight(rtu_line(Weigher(1)), 0.0) == weight(rtu_line(Weigher(1, weight=4999.66)), 0.0) == PRINTED_WEIGHT


def test_a_weight_stands_still_or_moves_a_little():
    line = rtu_line(Weigher(1, weight=12.5))
    assert {weight(line, float(second)) for second in range(20)} == {12.5}
    line = rtu_line(Weigher(1, weight=12.5, moves=True))
    weights = [weight(line, float(second)) for second in range(20)]
    assert len(set(weights)) == 20
    assert 10 < min(weights) < 12.5 < max(weights) < 15


def test_the_present_weight_becomes_zero():
    device = Weigher(1)
    line = rtu_line(device)
    assert exchange(line, TAKE_ZERO) == "01101a000001"
    assert weight(line, 1.0) == 0.0
    device.weight += 100.0
    assert weight(line, 2.0) == pytest.approx(100.0)


def test_zero_can_be_taken_again():
    device = Weigher(1, weight=50.0)
    line = rtu_line(device)
    exchange(line, TAKE_ZERO)
    device.weight = 80.0
    exchange(line, TAKE_ZERO, at=1.0)
    assert weight(line, 2.0) == 0.0


def test_it_answers_from_its_new_address_and_only_there():
    line = rtu_line(Weigher(1))
    assert exchange(line, BECOME_5) == "051001000001"
    assert exchange(line, READ_WEIGHT, at=1.0) is None
    assert exchange(line, "03 0010 0001", unit=5, at=2.0) == "0503020005"
    assert exchange(line, "03 0010 0001", unit=0, at=3.0) == "0503020005"


@pytest.mark.parametrize("address", ["0000", "00F8", "0105"])
def test_an_address_that_is_none_is_refused(address):
    line = rtu_line(Weigher(1))
    assert exchange(line, f"10 0100 0001 02 {address}") == "019003"
    assert exchange(line, "03 0010 0001", at=1.0) == "0103020001"


@pytest.mark.parametrize("baud", [14400, 19200])
def test_it_answers_at_the_old_rate_and_then_changes(baud):
    line = rtu_line(Weigher(1, baud=9600))
    write(line, rtu_frame(1, set_baud(baud)))
    first, second, *_ = arrivals(line)
    assert second.at - first.at == pytest.approx(11 / 9600)
    assert exchange(line, READ_WEIGHT, at=1.0, baud=9600) is None
    assert exchange(line, "03 0020 0002", at=2.0, baud=baud) == "010304" + pack(">f", baud).hex()


@pytest.mark.parametrize("baud", [0.0, 4800.0, 9600.5, 38400.0, -9600.0, float("nan"), float("inf")])
def test_other_rates_are_refused(baud):
    line = rtu_line(Weigher(1, baud=9600))
    assert exchange(line, set_baud(baud)) == "019003"
    assert exchange(line, READ_WEIGHT, at=1.0) is not None


def test_without_a_rate_of_its_own_it_shows_that_of_the_port():
    line = rtu_line(Weigher(1))
    assert exchange(line, "03 0020 0002", baud=19200) == "010304" + pack(">f", 19200).hex()


def test_it_cannot_be_made_with_another_rate():
    with pytest.raises(ValueError, match="cannot be set to 4800 baud"):
        Weigher(1, baud=4800)


@pytest.mark.parametrize(
    ("pdu", "exception"),
    [
        ("04 0000 0002", "8401"),
        ("06 0100 0005", "8601"),
        ("03 0002 0001", "8302"),
        ("03 0001 0002", "8302"),
        ("03 0100 0001", "8302"),
        ("03 1A00 0001", "8302"),
        ("10 0000 0002 04 00000000", "9002"),
        ("10 0010 0001 02 0005", "9002"),
        ("10 1A00 0002 04 00BB 0000", "9002"),
        ("10 1A00 0001 02 00BC", "9003"),
        ("10 0200 0001 02 4696", "9003"),
        ("10 0201 0001 02 0000", "9003"),
        ("03 0000 0000", "8303"),
    ],
)
def test_what_it_refuses(pdu, exception):
    assert exchange(rtu_line(Weigher(1)), pdu) == "01" + exception


def test_one_word_of_the_weight_can_be_read():
    assert exchange(rtu_line(Weigher(1)), "03 0000 0001") == "010302459c"


def test_at_address_0_it_answers_questions_only():
    line = rtu_line(Weigher(7))
    assert exchange(line, READ_WEIGHT, unit=0) == "070304459c3d51"
    assert exchange(line, "03 0005 0001", unit=0, at=1.0) == "078302"
    assert exchange(line, "04 0000 0002", unit=0, at=2.0) is None
    assert exchange(line, TAKE_ZERO, unit=0, at=3.0) is None
    assert exchange(line, READ_WEIGHT, unit=7, at=4.0) == "07030400000000"
