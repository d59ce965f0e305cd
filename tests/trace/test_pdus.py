"""Requests and responses in words."""

import pytest

from gateway.trace.pdus import frame_in_words, request_in_words, response_in_words


@pytest.mark.parametrize(
    ("request_pdu", "words"),
    [
        ("03 00 00 00 02", "read holding 0-1 (40001-40002)"),
        ("04 00 09 00 01", "read input 9 (30010)"),
        ("01 00 13 00 25", "read coils 19-55 (00020-00056)"),
        ("05 00 AC FF 00", "write coils 172 (00173): on"),
        ("05 00 AC 00 00", "write coils 172 (00173): off"),
        ("05 00 AC 55 00", "write coils 172 (00173): 5500"),
        ("06 00 87 03 9E", "write holding 135 (40136): 926"),
        ("10 00 01 00 02 04 00 0A 01 02", "write holding 1-2 (40002-40003): 10 258"),
        ("10 13 88 00 01 04 00 01 00 00", "write holding 5000 (45001): 65536"),
        ("0F 00 13 00 0A 02 CD 01", "write coils 19-28 (00020-00029): 1 0 1 1 0 0 1 1 1 0"),
        ("16 00 04 00 F2 00 25", "write holding 4 (40005)"),
        (
            "17 00 03 00 02 00 0E 00 01 02 00 FF",
            "write holding 14 (40015): 255, read holding 3-4 (40004-40005)",
        ),
        ("08 00 04 00 00", "08 diagnostics: 00 04 00 00"),
        ("11", "17 report server id"),
        ("41 01 02", "function 65: 01 02"),
        ("03 00 00 00 00", "03 read holding registers: 03 00 00 00 00"),
    ],
)
def test_a_request(request_pdu: str, words: str) -> None:
    assert request_in_words(bytes.fromhex(request_pdu)) == words


@pytest.mark.parametrize(
    ("request_pdu", "response", "words"),
    [
        ("03 00 00 00 02", "03 04 45 9C 3D 51", "17820 15697"),
        ("03 13 88 00 02", "03 08 00 01 00 00 00 00 00 02", "65536 2"),
        ("01 00 00 00 03", "01 01 05", "1 0 1"),
        ("06 00 87 03 9E", "06 00 87 03 9E", "written"),
        ("03 00 00 00 02", "83 02", "exception 02, illegal data address"),
        ("03 00 00 00 02", "83 63", "exception 63"),
        ("11", "11 02 01 FF", "17 report server id: 02 01 FF"),
        ("03 00 00 00 00", "03 00", "03 read holding registers: 03 00"),
    ],
)
def test_a_response(request_pdu: str, response: str, words: str) -> None:
    assert response_in_words(bytes.fromhex(request_pdu), bytes.fromhex(response)) == words


def test_many_values_are_counted() -> None:
    response = bytes((3, 40)) + bytes(40)
    assert response_in_words(bytes.fromhex("03 00 00 00 14"), response) == " ".join(["0"] * 16) + " and 4 more"


def test_a_frame_that_answers_nothing_known() -> None:
    assert frame_in_words(bytes.fromhex("83 02"), is_request=False) == "exception 02, illegal data address"
    assert frame_in_words(bytes.fromhex("03 00 00 00 01"), is_request=True) == "read holding 0 (40001)"
    assert frame_in_words(bytes.fromhex("03 02 00 01"), is_request=False) == "03 read holding registers: 03 02 00 01"
