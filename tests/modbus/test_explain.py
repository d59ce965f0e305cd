"""Why something is not the response to a request, and what it looks like."""

import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.modbus.explain import explain
from gateway.modbus.framings import likeness, looks_like
from gateway.modbus.pdu import parse_request

#: What was asked, what came from the unit in an intact frame, and why that is no response.
MISFITS = [
    ("03 0000 0001", "03 04 0001 0002", "intact, 4 data bytes where 2 were expected (32-bit registers?)"),
    ("04 0000 0002", "04 02 0001", "intact, 2 data bytes where 4 were expected"),
    ("01 0000 0008", "01 02 0001", "intact, 2 data bytes where 1 were expected"),
    ("17 0000 0001 0000 0001 02 0000", "17 06 0001 0002 0003", "intact, 6 data bytes where 2 were expected"),
    ("06 0001 00C8", "06 0001 0064", "echoed 0064, sent 00C8 (limited by the device)"),
    ("05 0001 FF00", "05 0001 0000", "echoed 0000, sent FF00"),
    ("16 0001 F0F0 0F0F", "16 0001 F0F0 0000", "echoed F0F00000, sent F0F00F0F"),
    ("10 0001 0002 04 0001 0002", "10 0001 0001", "intact, confirms 1 from 1 on where 2 from 1 on were sent"),
    ("0F 0001 0002 01 03", "0F 0000 0002", "intact, confirms 2 from 0 on where 2 from 1 on were sent"),
]
#: What an intact frame of the unit does not tell: it may be for somebody else, or a request.
SILENT = [
    ("03 0000 0001", "04 02 0001"),
    ("03 0000 0001", "03 0005 0002"),
    ("06 0001 00C8", "06 0002 00C8"),
    ("03 0000 0001", "83 02 00"),
]


def pdu(text: str) -> bytes:
    return bytes.fromhex(text)


@pytest.mark.parametrize(("asked", "came", "why"), MISFITS)
def test_an_intact_frame_that_does_not_fit_says_so(asked: str, came: str, why: str) -> None:
    request = parse_request(pdu(asked))
    assert not request.accepts(pdu(came))
    assert explain(request, 7, rtu.encode(7, pdu(came)), "rtu") == why
    assert explain(request, None, rtu.encode(9, pdu(came)), "rtu") == why
    assert explain(request, 7, ascii_framing.encode(7, pdu(came)), "ascii") == why
    assert explain(request, 7, mbap.encode(1, 7, pdu(came)), "tcp") == why


@pytest.mark.parametrize(("asked", "came"), SILENT)
def test_what_may_be_for_somebody_else_says_nothing(asked: str, came: str) -> None:
    assert explain(parse_request(pdu(asked)), 7, rtu.encode(7, pdu(came)), "rtu") == ""


@pytest.mark.parametrize(("asked", "came"), [*SILENT[1:], ("03 0000 0001", "03"), ("03 0000 0001", "03 04 0001")])
def test_a_response_over_tcp_of_the_right_function_is_not_said_to_be_of_another(asked: str, came: str) -> None:
    why = "intact, but with a wrong size or address"
    assert explain(parse_request(pdu(asked)), 7, mbap.encode(1, 7, pdu(came)), "tcp") == why


@pytest.mark.parametrize(
    "heard",
    [
        rtu.encode(8, pdu("03 04 0001 0002")),
        rtu.encode(7, pdu("03 04 0001 0002"))[:-1] + b"\0",
        rtu.encode(7, pdu("03 04 0001 0002")) + b"\0",
        b"\x55" + rtu.encode(7, pdu("03 04 0001 0002")),
        b"",
        b"\x07",
    ],
)
def test_another_unit_or_a_damaged_frame_says_nothing(heard: bytes) -> None:
    assert explain(parse_request(pdu("03 0000 0001")), 7, heard, "rtu") == ""


@pytest.mark.parametrize(
    ("adu", "why"),
    [
        (
            mbap.encode(0, 7, pdu("03 02 0001")),
            "intact, but its transaction identifier 0000 is not that of the request",
        ),
        (mbap.encode(1, 8, pdu("03 02 0001")), "intact, but from unit 8"),
        (mbap.encode(1, 255, pdu("03 04 0001 0002")), "intact, 4 data bytes where 2 were expected (32-bit registers?)"),
        (mbap.encode(1, 7, pdu("04 02 0001")), "intact, but of function 04"),
        (mbap.encode(1, 7, pdu("84 02")), "intact, but of function 04"),
    ],
)
def test_another_server_answers_this_request_only(adu: bytes, why: str) -> None:
    assert explain(parse_request(pdu("03 0000 0001")), 7, adu, "tcp") == why


def test_what_is_no_adu_says_nothing() -> None:
    assert explain(parse_request(pdu("03 0000 0001")), 7, b"HTTP", "tcp") == ""


ANSWER, ASKED = pdu("03 02 0007"), pdu("03 0000 000A")


@pytest.mark.parametrize(
    ("data", "framing"),
    [
        (mbap.encode(1, 1, ASKED), "Modbus TCP"),
        (mbap.encode(1, 1, ASKED) * 2, "Modbus TCP"),
        (mbap.encode(0x0103, 1, ANSWER), "Modbus TCP"),
        (mbap.encode(1, 1, pdu("83 02")), "Modbus TCP"),
        (rtu.encode(1, ASKED), "RTU"),
        (rtu.encode(1, pdu("03 0000 0002")), "RTU"),
        (rtu.encode(1, ASKED) * 3, "RTU"),
        (rtu.encode(1, ANSWER), "RTU"),
        (rtu.encode(1, pdu("83 02")) + b"\0", "RTU"),
        (ascii_framing.encode(1, ASKED), "ASCII"),
        (ascii_framing.encode(1, ANSWER) * 2, "ASCII"),
        (mbap.encode(1, 1, ASKED)[:-1], None),
        (rtu.encode(1, ASKED)[:-1] + b"\0", None),
        (bytes.fromhex("01 03 0000 0002 0BC4"), None),  # RTU with the bytes of the CRC in the wrong order
        (ascii_framing.encode(1, ASKED)[:-2], None),
        (b"GET / HTTP/1.1\r\n\r\n", None),
        (b"", None),
        (b"\0" * 300, None),
    ],
)
def test_the_framing_of_bytes_is_recognized(data: bytes, framing: str | None) -> None:
    assert looks_like(data) == framing


def test_its_own_framing_is_no_hint() -> None:
    frame = rtu.encode(1, ASKED)
    assert likeness(frame, "RTU") == ""
    assert likeness(frame, "Modbus TCP") == ": this looks like RTU, which rtu+tcp:// is for"
    assert likeness(mbap.encode(1, 1, ASKED), "RTU") == ": this looks like Modbus TCP, which tcp:// is for"
    assert likeness(ascii_framing.encode(1, ASKED), "RTU") == ": this looks like ASCII, which ascii+tcp:// is for"


@pytest.mark.parametrize(
    ("mode", "heard", "why"),
    [
        ("rtu", mbap.encode(1, 1, ANSWER), "this looks like Modbus TCP: [[upstream]] is for that"),
        ("ascii", mbap.encode(1, 1, ANSWER), "this looks like Modbus TCP: [[upstream]] is for that"),
        (
            "rtu",
            ascii_framing.encode(1, ANSWER),
            'this looks like ASCII: mode = "ascii", or ascii+tcp:// in port, is for that',
        ),
        ("ascii", rtu.encode(1, ANSWER), 'this looks like RTU: mode = "rtu", or rtu+tcp:// in port, is for that'),
    ],
)
def test_a_line_that_hears_another_framing_says_which(mode: str, heard: bytes, why: str) -> None:
    assert explain(parse_request(pdu("03 0000 0001")), 1, heard, mode) == why
