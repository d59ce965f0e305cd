"""The scanner of an ASCII line: what looks like the response with a damaged character."""

import pytest

from gateway.modbus.ascii import encode
from gateway.modbus.pdu import parse_request
from gateway.modbus.scan import NEVER, Expected
from gateway.modbus.scan_ascii import AsciiScanner

READ = bytes.fromhex("03 00 10 00 01")
RESPONSE = encode(1, bytes.fromhex("03 02 12 34"))


@pytest.mark.parametrize(
    ("data", "is_damaged"),
    [
        pytest.param(RESPONSE[:-3] + b"?\r\n", True, id="wrong check sum"),
        pytest.param(RESPONSE[:-2] + b"?\n", True, id="wrong CR"),
        pytest.param(RESPONSE[:-1] + b"?", True, id="wrong LF"),
        pytest.param(RESPONSE[:-2] + b"??", False, id="wrong CR and LF"),
        pytest.param(RESPONSE[:-2] + b"\n?", False, id="LF, and something behind it"),
        pytest.param(RESPONSE[:-3] + b"\r\n", False, id="a digit less"),
        pytest.param(b"?" + RESPONSE[1:], False, id="wrong colon"),
        pytest.param(RESPONSE.lower(), True, id="lower case"),
        pytest.param(encode(2, bytes.fromhex("03 02 12 34")), False, id="another unit"),
    ],
)
def test_a_damaged_response_has_its_size_its_beginning_and_half_of_its_end(data: bytes, is_damaged: bool) -> None:
    expected = Expected(1, parse_request(READ))
    assert AsciiScanner().is_damaged(data, expected, shared=True) == is_damaged


def test_a_response_to_an_unknown_unit_may_be_damaged_too() -> None:
    expected = Expected(None, parse_request(READ))
    assert AsciiScanner().is_damaged(RESPONSE[:-3] + b"?\r\n", expected, shared=True)
    assert not AsciiScanner().is_damaged(encode(1, bytes.fromhex("04 02 12 34")), expected, shared=True)


def test_the_response_comes_behind_the_echo_and_not_behind_another_frame() -> None:
    scanner = AsciiScanner()
    expected = Expected(1, parse_request(READ))
    scanner.expect(expected, encode(1, READ), echoes=True)
    scanner.received(RESPONSE, 1.0)
    assert expected.since == NEVER
    scanner.received(encode(1, READ), 1.1)
    assert expected.since == len(RESPONSE) + len(encode(1, READ))


def test_a_damaged_request_may_look_like_a_damaged_response() -> None:
    """So it is taken for one only where nobody else asks: a response to a write repeats it."""
    write = bytes.fromhex("06 00 01 00 05")
    data, expected = encode(1, write)[:-3] + b"?\r\n", Expected(1, parse_request(write))
    assert not AsciiScanner().is_damaged(data, expected, shared=True)
    assert AsciiScanner().is_damaged(data, expected, shared=False)
