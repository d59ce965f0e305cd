"""What an RTU scanner remembers from one chunk to the next, and what it says of the bytes that are still to come."""

import pytest

from gateway.modbus.codes import MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import exception_response, parse_request
from gateway.modbus.rtu import encode
from gateway.modbus.scan import NEVER, Expected
from gateway.modbus.scan_rtu import HOLE, RtuScanner

SILENCE = 0.002
READ = bytes.fromhex("03 00 10 00 0A")
ANSWER = bytes.fromhex("03 14") + bytes(range(1, 21))
RESPONSE = encode(1, ANSWER)
REQUEST = encode(1, READ)
OTHERS = encode(2, bytes.fromhex("03 02 12 34"))
#: Of an unknown function: silence ends its response.
OWN = bytes.fromhex("41 01")
OWN_RESPONSE = encode(1, bytes.fromhex("41 02 03"))


def scanning(pdu: bytes = READ, *, unit: int | None = 1, echoes: bool = False) -> tuple[RtuScanner, Expected]:
    scanner = RtuScanner(SILENCE)
    expected = Expected(unit, parse_request(pdu))
    scanner.expect(expected, encode(1, pdu), echoes=echoes)
    return scanner, expected


def places(tokens: list) -> list[tuple[int, int, float, Frame]]:
    return [(token.start, token.end, token.at, token.frame) for token in tokens]


# --- how much is missing ---


@pytest.mark.parametrize(("come", "missing"), [(1, 5 - 1), (2, 25 - 2), (24, 1)])
def test_of_the_response_as_much_as_its_request_says(come: int, missing: int) -> None:
    scanner, _ = scanning()
    scanner.received(RESPONSE[:come], 1.0)
    assert scanner.missing == missing


def test_of_an_exception_as_much_as_of_any() -> None:
    scanner, _ = scanning()
    scanner.received(encode(1, exception_response(3, 2))[:3], 1.0)
    assert scanner.missing == 2


def test_behind_the_echo_only_the_response_counts() -> None:
    scanner, _ = scanning(echoes=True)
    scanner.received(REQUEST[:5], 1.0)
    assert scanner.missing == 0
    scanner.received(REQUEST[5:] + RESPONSE[:3], 1.0)
    assert scanner.missing == len(RESPONSE) - 3
    (token,) = scanner.received(RESPONSE[3:], 1.1)
    assert (token.start, token.frame) == (len(REQUEST), (1, ANSWER))


def test_behind_early_bytes_only_what_follows_counts() -> None:
    scanner, expected = scanning()
    assert places(scanner.received(REQUEST, 1.0, early=True)) == [(0, 8, 1.0, (1, READ))]
    assert expected.since == len(REQUEST)
    scanner.received(RESPONSE[:3], 1.1)
    assert scanner.missing == len(RESPONSE) - 3


@pytest.mark.parametrize("unit", [1, 3])
def test_whoever_may_respond_may_send_an_exception(unit: int) -> None:
    """A unit identifier that looks like the function is no reason to wait longer."""
    scanner, _ = scanning(unit=None)
    scanner.received(encode(unit, ANSWER)[:1], 1.0)
    assert scanner.missing == 0


def test_nothing_when_other_bytes_came() -> None:
    scanner, _ = scanning()
    scanner.received(OTHERS[:3], 1.0)
    assert scanner.missing == 0


def test_nothing_of_a_request_that_is_over() -> None:
    scanner, _ = scanning()
    scanner.received(RESPONSE[:3], 1.0)
    scanner.end()
    assert scanner.missing == 0


# --- what silence ends ---


def test_silence_has_nothing_to_end_before_a_response_of_unknown_size_has_begun() -> None:
    scanner, expected = scanning(OWN)
    assert scanner.deadline(expected) is None
    scanner.received(OWN_RESPONSE, 1.0)
    assert scanner.deadline(expected) == 1.0 + SILENCE
    assert scanner.tick(1.0 + SILENCE / 2) == []
    assert places(scanner.tick(1.0 + SILENCE)) == [(0, 6, 1.0, (1, OWN_RESPONSE[1:-2]))]
    assert scanner.deadline(expected) is None
    assert scanner.tick(1.0 + 2 * SILENCE) == []


def test_nor_of_one_that_can_begin_only_behind_what_has_come() -> None:
    scanner, expected = scanning(OWN)
    scanner.received(REQUEST, 1.0, early=True)
    assert scanner.deadline(expected) is None


def test_silence_does_not_end_a_response_of_known_size() -> None:
    scanner, expected = scanning()
    scanner.received(RESPONSE[:10], 1.0)
    assert scanner.deadline(expected) is None
    assert scanner.tick(1.0 + SILENCE) == []
    assert scanner.missing == len(RESPONSE) - 10
    assert places(scanner.received(RESPONSE[10:], 1.5)) == [(0, 25, 1.5, (1, ANSWER))]


def test_a_late_response_of_unknown_size_may_come_before_the_response() -> None:
    """Its unit is that of the response, so its first byte could be that of the response too."""
    scanner, _ = scanning()
    late = Expected(1, parse_request(OWN))
    scanner.late = [late]
    scanner.received(OWN_RESPONSE, 1.0)
    assert scanner.deadline(late) == 1.0 + SILENCE
    assert places(scanner.tick(1.0 + SILENCE)) == [(0, 6, 1.0, (1, OWN_RESPONSE[1:-2]))]
    assert places(scanner.received(RESPONSE, 2.0)) == [(6, 31, 2.0, (1, ANSWER))]


# --- what is found ---


def test_a_frame_inside_a_response_that_was_cut_is_found_when_that_is_not_awaited_any_more() -> None:
    scanner, expected = scanning()
    assert scanner.received(b"\x55" + RESPONSE[:3] + OTHERS, 1.0) == []
    assert scanner.deadline(expected) is None
    assert scanner.tick(1.0 + SILENCE) == []
    assert places(scanner.end()) == [(4, 11, 1.0, (2, OTHERS[1:-2]))]
    assert scanner.end() == ()


def test_a_response_that_only_its_request_tells_the_size_of_is_found_behind_noise() -> None:
    """The data that 08 00 returns may have any size."""
    pdu = bytes.fromhex("08 00 00 A5 37 01 02 03 04")
    scanner, _ = scanning(pdu)
    assert places(scanner.received(b"\xaa\x55" + encode(1, pdu), 1.0)) == [(2, 14, 1.0, (1, pdu))]


def test_a_response_that_begins_with_equal_bytes_is_found_behind_one_more_of_them() -> None:
    scanner, _ = scanning(OWN, unit=0x41)
    scanner.received(b"\x41" + encode(0x41, OWN_RESPONSE[1:-2]), 1.0)
    assert places(scanner.tick(1.0 + SILENCE)) == [(1, 7, 1.0, (0x41, OWN_RESPONSE[1:-2]))]


def test_a_response_whose_size_is_known_is_whole_only_at_that_size() -> None:
    """The data that is to be returned is the check sum of what stands before it."""
    begun = encode(1, bytes.fromhex("08 00 00"))
    pdu = begun[1:]
    scanner, _ = scanning(pdu)
    assert scanner.received(b"\xaa" + begun, 1.0) == []
    assert places(scanner.received(encode(1, pdu)[-2:], 1.1)) == [(1, 9, 1.1, (1, pdu))]


def test_a_frame_inside_a_response_waits_however_much_noise_came_before() -> None:
    scanner, _ = scanning()
    assert scanner.received(b"\x55" * 600, 1.0) == []
    assert scanner.received(RESPONSE[:3] + OTHERS, 1.1) == []
    assert places(scanner.end()) == [(603, 610, 1.1, (2, OTHERS[1:-2]))]


def test_a_response_may_be_only_a_function() -> None:
    scanner, _ = scanning(OWN)
    scanner.received(encode(1, b"\x41"), 1.0)
    assert places(scanner.tick(1.0 + SILENCE)) == [(0, 4, 1.0, (1, b"\x41"))]


def test_each_frame_has_the_time_at_which_its_last_byte_was_read() -> None:
    """However much of it could have been the beginning of the response."""
    scanner, _ = scanning()
    scanner.received(RESPONSE[:9], 1.0)
    assert places(scanner.received(RESPONSE[9:], 1.1)) == [(0, 25, 1.1, (1, ANSWER))]
    scanner.end()
    mine = encode(1, bytes.fromhex("04 02 12 34"))
    scanner.expect(Expected(1, parse_request(READ)), REQUEST, echoes=False)
    scanner.received(mine[:1], 2.0)
    scanner.received(mine[1:] + OTHERS[:3], 2.1)
    tokens = scanner.received(OTHERS[3:], 2.2)
    assert places(tokens) == [(32, 39, 2.2, (2, OTHERS[1:-2]))]


def test_bytes_that_were_taken_for_the_response_are_looked_at_again_at_their_own_times() -> None:
    scanner, _ = scanning()
    first = encode(1, exception_response(3, 2))
    scanner.received(first[:2], 1.0)
    scanner.received(first[2:4], 1.1)
    assert scanner.received(b"\x00", 1.2) == []
    assert places(scanner.received(OTHERS, 1.3)) == [(5, 12, 1.3, (2, OTHERS[1:-2]))]


@pytest.mark.parametrize(("hole", "found"), [(HOLE, True), (HOLE + 0.001, False)])
def test_on_the_idle_line_a_long_gap_parts_frames(hole: float, found: bool) -> None:
    scanner = RtuScanner(SILENCE)
    assert scanner.received(OTHERS[:4], 100.0) == []
    assert bool(scanner.received(OTHERS[4:], 100.0 + hole)) == found


def test_but_not_while_a_response_is_awaited() -> None:
    scanner, _ = scanning()
    scanner.received(OTHERS[:4], 100.0)
    assert scanner.received(OTHERS[4:], 101.5)


def test_an_echo_that_came_early_is_not_that_of_the_request() -> None:
    scanner, expected = scanning(echoes=True)
    scanner.received(REQUEST, 1.0, early=True)
    assert expected.since == NEVER
    scanner.received(REQUEST, 1.1)
    (token,) = scanner.received(RESPONSE, 1.2)
    assert (token.start, expected.since) == (16, 16)


# --- damage ---


@pytest.mark.parametrize(
    ("data", "is_damaged"),
    [
        pytest.param(RESPONSE[:-1] + b"\0", True, id="wrong check sum"),
        pytest.param(RESPONSE[:-1], False, id="too short"),
        pytest.param(RESPONSE + b"\0", False, id="too long"),
        pytest.param(b"\2" + RESPONSE[1:], False, id="another unit"),
        pytest.param(encode(1, exception_response(3, 2))[:-1] + b"\0", True, id="exception"),
        pytest.param(encode(1, exception_response(3, 2)) + b"\0", False, id="exception, too long"),
        pytest.param(encode(1, exception_response(4, 2))[:-1] + b"\0", False, id="exception of another function"),
    ],
)
def test_a_damaged_response_has_its_size_and_its_beginning(data: bytes, is_damaged: bool) -> None:
    scanner, expected = scanning()
    assert scanner.is_damaged(data, expected, shared=True) == is_damaged


def test_a_damaged_request_may_look_like_a_damaged_response() -> None:
    """So it is taken for one only where nobody else asks: a response to a write repeats it."""
    write = bytes.fromhex("06 00 01 00 05")
    scanner, expected = scanning(write)
    assert not scanner.is_damaged(encode(1, write)[:-1] + b"\0", expected, shared=True)
    assert scanner.is_damaged(encode(1, write)[:-1] + b"\0", expected, shared=False)


def test_a_damaged_byte_is_remembered_only_for_the_frame_that_it_is_in() -> None:
    scanner, _ = scanning()
    (first,) = scanner.received(OTHERS, 1.0, damaged=True)
    (second,) = scanner.received(OTHERS, 1.1)
    assert (first.is_damaged, second.is_damaged) == (True, False)


def test_a_response_with_a_damaged_byte_is_a_damaged_frame() -> None:
    scanner, _ = scanning()
    assert scanner.received(RESPONSE[:4], 1.0) == []
    assert scanner.received(RESPONSE[4:6], 1.1, damaged=True) == []
    (token,) = scanner.received(RESPONSE[6:], 1.2)
    assert token.is_damaged


# --- the largest responses ---


@pytest.mark.parametrize("size", [1, 7, MAX_RTU_ADU])
@pytest.mark.parametrize("head", ["41", "11 FB"], ids=["ended by silence", "with a byte count"])
def test_an_exception_inside_of_the_largest_response_is_data(head: str, size: int) -> None:
    begin = bytes.fromhex(head)
    pdu = begin + encode(1, exception_response(begin[0], 2)) + bytes(MAX_PDU - len(begin) - 6) + b"\x01"
    scanner, _ = scanning(begin[:1])
    whole = encode(1, pdu)
    assert len(whole) == MAX_RTU_ADU
    tokens = [token for at in range(0, len(whole), size) for token in scanner.received(whole[at : at + size], 1.0)]
    tokens += scanner.tick(1.0 + 2 * SILENCE)
    assert [token.frame for token in tokens] == [(1, pdu)]


# --- frames that nobody has asked for ---


def test_a_frame_of_the_largest_size_is_found_though_it_tells_that_only_in_its_third_byte() -> None:
    server_id = bytes((17, MAX_PDU - 2)) + bytes(MAX_PDU - 2)
    assert [token.frame for token in RtuScanner(SILENCE).received(encode(9, server_id), 1.0)] == [(9, server_id)]


def test_what_has_begun_before_a_hole_is_not_completed_behind_it() -> None:
    """Its size ends on a frame that begins like it."""
    scanner = RtuScanner(SILENCE)
    begun, other = bytes.fromhex("01 03 14 00 00 00 00 00"), encode(1, bytes.fromhex("03 14 00 00 01"))
    assert scanner.received(begun, 1.0) == []
    tokens = scanner.received(bytes(25 - len(begun) - len(other)) + other, 1.0 + 2 * HOLE)
    assert [(token.start, token.frame.pdu) for token in tokens] == [(25 - len(other), other[1:-2])]
