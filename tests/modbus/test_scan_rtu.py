"""The response framer: what a client hears on an RTU line after its request."""

from itertools import combinations, pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.frame import Frame
from gateway.modbus.pdu import exception_response, parse_request
from gateway.modbus.rtu import crc_fits, encode, with_crc
from gateway.modbus.scan_rtu import RtuScanner
from kit.asked import SILENCE, Asked
from kit.noise import chunkings, noise
from kit.vectors import ANSWER, QUESTION, UNIT, broken, exchanges, meaning, seed_frames

GOOD = encode(UNIT, ANSWER)
#: An unknown function: its response ends by silence.
UNKNOWN = bytes.fromhex("41 01 02 03")

PRINTED = [frame for frame in seed_frames() if frame.mode == "rtu"]
#: Each response in the manufacturers' documents with the request that is printed before it.
PRINTED_PAIRS = [(one, two) for one, two in pairwise(PRINTED) if two.kind == "response"]


def asked(pdu: bytes = QUESTION, unit: int = UNIT) -> Asked:
    return Asked(unit, parse_request(pdu))


def ended_by_silence(data: bytes, units: set[int]) -> list[Frame]:
    scanner = RtuScanner(SILENCE)
    scanner.received(data, 0.0)
    return scanner.ended_by_silence(units)


def hear(framer: Asked, *chunks: bytes) -> list[Frame]:
    """What comes of chunks that follow each other at once, and the silence behind them."""
    frames = [frame for chunk in chunks for frame in framer.received(chunk, 0.0)]
    return frames + framer.tick(SILENCE)


@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
class TestVectors:
    def test_encodes(self, exchange):
        assert encode(UNIT, exchange.request.pdu) == exchange.request.rtu
        assert encode(UNIT, exchange.response.pdu) == exchange.response.rtu

    def test_decodes_in_any_chunks(self, exchange):
        for chunks in chunkings(exchange.response.rtu):
            framer = asked(exchange.request.pdu)
            assert hear(framer, *chunks) == [(UNIT, exchange.response.pdu)]
            assert framer.conclude() == []
            assert not framer.heard_noise

    def test_decodes_behind_noise(self, exchange):
        for before in (b"\x00\xff", b"\x00", noise(40), exchange.response.rtu[:-1], exchange.request.rtu[:-2]):
            framer = asked(exchange.request.pdu)
            assert hear(framer, before + exchange.response.rtu) == [(UNIT, exchange.response.pdu)]
            assert framer.heard_noise


@pytest.mark.parametrize("exchange", [each for each in exchanges() if each.response_tells_size], ids=meaning)
def test_a_response_of_foretold_size_is_found_with_noise_behind(exchange):
    for behind in (b"\x00", noise(3), noise(300)):
        framer = asked(exchange.request.pdu)
        assert hear(framer, exchange.response.rtu + behind) == [(UNIT, exchange.response.pdu)]
        framer.conclude()
        assert framer.heard_noise


@pytest.mark.parametrize(("request_frame", "response_frame"), PRINTED_PAIRS, ids=lambda frame: frame.meaning)
def test_printed_frames_are_accepted_from_the_unit_that_answers(request_frame, response_frame):
    framer = asked(request_frame.data[1:-2], unit=response_frame.data[0])
    assert hear(framer, response_frame.data) == [(response_frame.data[0], response_frame.data[1:-2])]


@pytest.mark.parametrize("frame", [frame for frame in PRINTED if frame.kind == "misprint"], ids=meaning)
def test_printed_frames_with_a_wrong_check_are_refused(frame):
    framer = asked(bytes.fromhex("03 00 00 00 01"), unit=frame.data[0])
    assert hear(framer, frame.data) == framer.conclude() == []
    assert framer.heard_noise


@pytest.mark.parametrize("vector", broken("rtu"), ids=meaning)
def test_broken_and_foreign_frames_are_no_response(vector):
    for chunks in chunkings(vector.data):
        framer = asked()
        assert hear(framer, *chunks) == []
        passed_over = framer.conclude()
        assert framer.heard_noise is not bool(passed_over)
        if vector.rejected_by == "check":
            assert passed_over == []


@pytest.mark.parametrize("vector", broken("rtu"), ids=meaning)
def test_a_good_response_behind_a_broken_one_is_found(vector):
    assert hear(asked(), vector.data + GOOD) == [(UNIT, ANSWER)]


def test_a_hole_does_not_end_a_response_of_foretold_size():
    framer = asked()
    assert framer.received(GOOD[:4], 0.0) == []
    assert framer.deadline() is None
    assert framer.tick(0.4) == []
    assert framer.received(GOOD[4:], 0.5) == [(UNIT, ANSWER)]


def with_fitting_prefix() -> tuple[bytes, bytes]:
    """A response to UNKNOWN whose first bytes are a frame with a fitting CRC: head, value, CRC, then two bytes more."""
    prefix = encode(UNIT, b"\x41\x07")
    return prefix, encode(UNIT, prefix[1:] + b"\x08\x09")


def test_a_fitting_crc_does_not_end_a_response_of_unknown_size():
    prefix, whole = with_fitting_prefix()
    assert crc_fits(prefix)
    for chunks in ([prefix, whole[len(prefix) :]], [bytes((byte,)) for byte in whole]):
        assert hear(asked(UNKNOWN), *chunks) == [(UNIT, whole[1:-2])]


def test_a_fitting_crc_does_not_end_a_response_of_foretold_size():
    values = encode(UNIT, b"\x03\x06\x00\x00")[3:]  # the CRC of the first two bytes of data becomes the next two
    response = encode(UNIT, b"\x03\x06" + values + b"\x12\x34")
    assert crc_fits(response[:7])
    assert hear(asked(), *(bytes((byte,)) for byte in response)) == [(UNIT, response[1:-2])]


class TestUnknownFunction:
    """Its response has no foretold size."""

    RESPONSE = bytes.fromhex("41 04")

    def test_silence_ends_it(self):
        framer = asked(UNKNOWN)
        assert framer.received(encode(UNIT, self.RESPONSE), 1.0) == []
        assert framer.deadline() == 1.0 + SILENCE
        assert framer.tick(1.0 + SILENCE / 2) == []
        assert framer.tick(1.0 + SILENCE) == [(UNIT, self.RESPONSE)]
        assert framer.deadline() is None

    def test_each_byte_puts_the_silence_off(self):
        framer = asked(UNKNOWN)
        framer.received(b"\x11", 1.0)
        framer.received(b"\x41", 1.001)
        assert framer.deadline() == 1.001 + SILENCE

    def test_its_exception_ends_at_once(self):
        framer = asked(UNKNOWN)
        assert framer.received(encode(UNIT, b"\xc1\x01"), 0.0) == [(UNIT, b"\xc1\x01")]

    def test_a_silence_in_it_ends_it_too(self):
        framer, data = asked(UNKNOWN), encode(UNIT, self.RESPONSE)
        assert hear(framer, data[:3]) == []
        assert hear(framer, data[3:]) == []
        assert hear(framer, data) == [(UNIT, self.RESPONSE)]

    def test_a_frame_behind_the_silence_is_no_data_of_it(self):
        framer = asked(UNKNOWN)
        hear(framer, encode(UNIT, self.RESPONSE)[:3])
        framer.received(encode(UNIT + 1, ANSWER), 1.0)
        assert framer.others == [(UNIT + 1, ANSWER)]

    def test_the_longest_frame_is_found(self):
        pdu = b"\x41" + noise(252)
        framer = asked(UNKNOWN)
        assert hear(framer, encode(UNIT, pdu)) == [(UNIT, pdu)]
        assert not framer.heard_noise
        assert hear(asked(UNKNOWN), noise(100) + encode(UNIT, pdu)) == [(UNIT, pdu)]

    def test_its_head_with_nothing_behind_is_no_response(self):
        framer = asked(UNKNOWN)
        assert hear(framer, b"\x11\x41") == framer.conclude() == []
        assert framer.heard_noise

    def test_a_unit_and_a_fitting_crc_are_no_response(self):
        """The CRC of unit 17 begins with 7F: without a PDU it looks like function 127."""
        data = with_crc(bytes((UNIT,)))
        framer = asked(data[1:2])
        assert hear(framer, data) == []


def test_an_exception_of_a_known_function_ends_at_once():
    assert asked().received(encode(UNIT, exception_response(3, 2)), 0.0) == [(UNIT, b"\x83\x02")]


def test_a_well_formed_frame_of_another_unit_is_passed_over_and_told():
    framer, foreign = asked(), encode(5, ANSWER)
    assert hear(framer, foreign) == []
    assert framer.conclude() == [(5, ANSWER)]
    assert not framer.heard_noise


def test_foreign_frames_among_noise_are_told():
    framer = asked()
    assert hear(framer, b"\x00\xff" + encode(5, b"\x83\x02") + encode(6, ANSWER) + b"\x00") == []
    assert framer.conclude() == [(5, b"\x83\x02"), (6, ANSWER)]
    assert framer.heard_noise


def test_a_frame_inside_a_foreign_frame_may_be_data_and_both_are_told():
    framer, foreign = asked(), encode(5, b"\x03\x06" + encode(6, b"\x83\x02") + b"\x00")
    assert hear(framer, foreign) == []
    assert framer.conclude() == [(6, b"\x83\x02"), (5, foreign[1:-2])]


def test_silence_is_no_noise():
    framer = asked()
    assert framer.conclude() == []
    assert not framer.heard_noise


def test_a_new_request_forgets_what_was_heard():
    framer = asked()
    hear(framer, noise(300) + GOOD[:-1])
    framer.expect(UNIT, parse_request(QUESTION))
    assert not framer.heard_noise
    assert framer.received(GOOD[-1:], 0.0) == []
    assert framer.received(GOOD, 0.0) == [(UNIT, ANSWER)]


def test_endless_noise_is_not_kept():
    framer = asked(UNKNOWN)
    for _ in range(100):
        framer.received(noise(512), 0.0)
    assert len(framer.scanner._buffer) <= 256
    assert framer.heard_noise


@given(st.binary(max_size=300), st.binary(max_size=300), st.integers(0, 400))
def test_any_noise_around_and_any_cut_give_the_same_response(before, behind, cut):
    data = before + GOOD + behind
    framer = asked()
    frames = framer.received(data[:cut], 0.0) or framer.received(data[cut:], 0.0)
    assert frames == [(UNIT, ANSWER)]


@given(st.sampled_from([QUESTION, UNKNOWN]), st.lists(st.binary(max_size=300)))
def test_garbage_raises_nothing(question, chunks):
    framer = asked(question)
    for frame in hear(framer, *chunks) + framer.conclude():
        assert 1 <= len(frame.pdu) <= 253


# --- exceptions and data that looks like them ---

#: Asks for three registers. Its answer's data is an exception response, and a byte of the next register's.
THREE = bytes.fromhex("03 00 10 00 03")
LOOKS_REFUSED = encode(1, bytes.fromhex("03 06 01 83 02 C0 F1 00"))


def from_anywhere(pdu: bytes = THREE) -> Asked:
    """One that looks for an answer from whatever unit."""
    return Asked(None, parse_request(pdu))


@pytest.mark.parametrize("expecting", [lambda: asked(THREE, 1), from_anywhere], ids=["unit 1", "any unit"])
def test_an_exception_inside_the_data_of_a_response_is_data(expecting):
    assert LOOKS_REFUSED[3:8] == encode(1, b"\x83\x02")
    for chunks in chunkings(LOOKS_REFUSED):
        assert hear(expecting(), *chunks) == [(1, LOOKS_REFUSED[1:-2])]


@pytest.mark.parametrize("expecting", [lambda: asked(THREE, 1), from_anywhere], ids=["unit 1", "any unit"])
def test_an_exception_inside_a_response_that_turns_out_broken_is_found_behind_it(expecting):
    """When the whole of it is there and its CRC is wrong, it was no response: the exception may have been one."""
    broken_response = LOOKS_REFUSED[:-1] + b"\x00"
    for chunks in chunkings(broken_response):
        assert hear(expecting(), *chunks) == [(1, b"\x83\x02")]


def test_an_exception_before_the_beginning_of_a_response_is_found_at_once():
    framer = asked(THREE, 1)
    assert framer.received(encode(1, b"\x83\x02") + LOOKS_REFUSED[:6], 0.0) == [(1, b"\x83\x02")]


def test_all_responses_are_told_in_the_order_they_came_however_they_are_cut():
    refused = encode(UNIT, b"\x83\x02")
    frames = {GOOD: (UNIT, ANSWER), refused: (UNIT, b"\x83\x02")}
    for order in product(frames, repeat=3):
        for chunks in chunkings(b"\x55".join(order)):
            framer = asked()
            assert hear(framer, *chunks) == [frames[frame] for frame in order]
            assert framer.heard_noise


def test_a_response_from_anywhere_is_told_with_its_unit():
    for unit in (1, 77, 247):
        assert hear(from_anywhere(), b"\x03", encode(unit, LOOKS_REFUSED[1:-2])) == [(unit, LOOKS_REFUSED[1:-2])]


def test_the_rest_of_a_response_completes_it_after_it_was_given_up():
    """A late response may have begun in time."""
    framer = asked()
    framer.received(GOOD[:5], 0.0)
    framer.conclude()
    assert framer.heard_noise
    assert framer.received(GOOD[5:], 1.0) == [(UNIT, ANSWER)]


def test_a_response_of_an_unknown_function_reaches_to_the_end():
    odd = encode(UNIT, b"\x41\x01\x02")
    assert ended_by_silence(b"\x55" + odd, {UNIT}) == [(UNIT, b"\x41\x01\x02")]
    assert ended_by_silence(b"\x55" + odd, {UNIT + 2}) == []
    assert ended_by_silence(odd + b"\x55", {UNIT}) == []
    assert ended_by_silence(odd[:3], {UNIT}) == []


def test_a_response_of_a_known_function_is_not_ended_by_silence():
    assert ended_by_silence(GOOD, {UNIT}) == []


# --- responses that tell their own size ---


def _tells_its_own_size(request):
    return request.response_size is None and request.longest_response > 0


OWN_SIZE = [each for each in exchanges() if _tells_its_own_size(parse_request(each.request.pdu))]


def test_the_functions_whose_responses_tell_their_own_size():
    assert {each.request.pdu[0] for each in OWN_SIZE} == {12, 17, 24, 43}


@pytest.mark.parametrize("exchange", [each for each in exchanges() if each.response_tells_size], ids=meaning)
def test_a_response_ends_on_its_last_byte(exchange):
    framer = asked(exchange.request.pdu)
    for byte in exchange.response.rtu[:-1]:
        assert framer.received(bytes((byte,)), 0.0) == []
        assert framer.deadline() is None
    assert framer.received(exchange.response.rtu[-1:], 9.0) == [(UNIT, exchange.response.pdu)]


@given(st.sampled_from(OWN_SIZE), st.binary(max_size=300), st.binary(max_size=300), st.lists(st.integers(0, 700)))
def test_noise_around_and_cuts_change_nothing(exchange, before, behind, cuts):
    data = before + exchange.response.rtu + behind
    chunks = [data[one:two] for one, two in pairwise([0, *sorted(cuts), len(data)])]
    assert hear(asked(exchange.request.pdu), *chunks) == [(UNIT, exchange.response.pdu)]


@given(st.sampled_from(OWN_SIZE), st.lists(st.integers(0, 3), max_size=6), st.data())
def test_beginnings_of_responses_before_a_response_do_not_hide_it(exchange, kinds, data):
    """What noise may look like at worst. Behind such a beginning, only silence shows that it was one."""
    head, response = bytes((UNIT,)) + parse_request(exchange.request.pdu).response_head, exchange.response.rtu
    parts = [[head, response[:-1], exchange.request.rtu, head + b"\xff"][kind] for kind in kinds]
    stream = b"".join(parts) + response
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)))))
    heard = hear(asked(exchange.request.pdu), *(stream[one:two] for one, two in pairwise([0, *cuts, len(stream)])))
    assert heard[-1:] == [(UNIT, exchange.response.pdu)]


@pytest.mark.parametrize("exchange", OWN_SIZE, ids=meaning)
def test_an_exception_ends_at_once(exchange):
    refused = exception_response(exchange.request.pdu[0], 1)
    assert asked(exchange.request.pdu).received(encode(UNIT, refused), 0.0) == [(UNIT, refused)]


def test_a_frame_inside_a_response_that_tells_its_own_size_is_data():
    inside = encode(UNIT, b"\x11\x01\xff") + encode(UNIT, b"\x91\x01")
    whole = encode(UNIT, b"\x11" + bytes((len(inside) + 1,)) + inside + b"\xff")
    for chunks in chunkings(whole):
        assert hear(asked(b"\x11"), *chunks) == [(UNIT, whole[1:-2])]


def test_a_response_behind_an_echo_that_looks_like_a_beginning_is_found_after_a_silence():
    """The CRC of the request 11 to unit 17 stands where its response has the byte count, and promises CD more bytes."""
    framer = asked(b"\x11")
    request, response = encode(UNIT, b"\x11"), encode(UNIT, b"\x11\x02\x2a\xff")
    assert framer.received(request + response, 1.0) == []
    assert framer.deadline() == 1.0 + SILENCE
    assert framer.tick(1.0) == []
    assert framer.tick(1.0 + SILENCE) == [(UNIT, b"\x11\x02\x2a\xff")]
    assert framer.conclude() == [(UNIT, b"\x11")]
    assert framer.deadline() is None


def test_a_beginning_that_is_too_long_to_be_one_is_passed_over_at_once():
    for beginning in (b"\x11\x0c\x47", b"\x11\x0c\xff", b"\x11\x0c\x48"):
        framer = asked(b"\x0c")
        log = encode(UNIT, bytes.fromhex("0C 06 0000 0000 0001"))
        assert framer.received(beginning + log, 0.0) == [(UNIT, log[1:-2])]


def test_an_exception_further_behind_a_beginning_than_a_frame_is_long_is_found_at_once_however_it_is_cut():
    refused = encode(UNIT, exception_response(UNKNOWN[0], 2))
    data = bytes((UNIT, UNKNOWN[0])) + bytes(256) + refused
    for chunks in chunkings(data):
        framer = asked(UNKNOWN)
        assert [frame for chunk in chunks for frame in framer.received(chunk, 0.0)] == [(UNIT, refused[1:-2])]


def test_nul_bytes_behind_a_response_of_unknown_size_leave_it_undecided():
    """They leave the CRC right: which of the frames was sent, nobody can tell."""
    framer = asked(UNKNOWN)
    assert hear(framer, encode(UNIT, bytes.fromhex("41 07")) + b"\0") == []
    assert hear(asked(UNKNOWN), encode(UNIT, bytes.fromhex("41 07"))) == [(UNIT, bytes.fromhex("41 07"))]


def test_a_response_of_unknown_size_whose_crc_ends_with_nul_is_undecided_too():
    ends_with_nul = next(pdu for each in range(256) if encode(UNIT, pdu := bytes((0x41, each)))[-1] == 0)
    assert hear(asked(UNKNOWN), encode(UNIT, ends_with_nul)) == []


def test_an_exception_behind_a_foreign_frame_that_holds_the_beginning_of_a_response():
    """The beginning is another unit's data, so no response is coming that the exception could be a part of."""
    asks_125 = bytes.fromhex("03 00 00 00 7D")
    foreign = encode(UNIT + 1, bytes((3, 4, UNIT, 3, 0xFA, 0)))
    exception = Frame(UNIT, b"\x83\x02")
    for chunks in chunkings(foreign + encode(*exception)):
        assert hear(asked(asks_125), *chunks) == [exception]


class TestDamaged:
    """At least one of some bytes is not what was sent, whatever the CRC says."""

    @staticmethod
    def hear(framer: Asked, data: bytes, start: int, end: int) -> list[Frame]:
        frames = framer.received(data[:start], 0.0) + framer.received(data[start:end], 0.0, damaged=True)
        return frames + hear(framer, data[end:])

    @pytest.mark.parametrize("answer", [ANSWER, exception_response(QUESTION[0], 2), UNKNOWN])
    def test_no_frame_has_all_of_them_in_it(self, answer):
        good = encode(UNIT, answer)
        for start, end in combinations(range(len(good) + 1), 2):
            framer = asked(UNKNOWN if answer is UNKNOWN else QUESTION)
            assert self.hear(framer, good, start, end) == framer.conclude() == []
            assert framer.heard_noise

    @pytest.mark.parametrize("end", range(1, len(GOOD) + 1))
    @pytest.mark.parametrize("answer", [ANSWER, UNKNOWN])
    def test_it_may_have_been_the_glitch_before_a_frame(self, answer, end):
        """An adapter marks all that came in one packet."""
        framer = asked(UNKNOWN if answer is UNKNOWN else QUESTION)
        assert self.hear(framer, b"\xff" + encode(UNIT, answer), 0, end) == [(UNIT, answer)]

    @pytest.mark.parametrize("start", range(len(GOOD)))
    def test_it_may_have_been_the_glitch_behind_a_frame(self, start):
        assert self.hear(asked(), GOOD + b"\xff", start, len(GOOD) + 1) == [(UNIT, ANSWER)]

    @pytest.mark.parametrize("question", [QUESTION, UNKNOWN])
    @pytest.mark.parametrize("before", [b"\0", bytes(300), GOOD[:-1]])
    def test_the_frame_behind_them_is_found(self, question, before):
        framer = asked(question)
        answer = ANSWER if question is QUESTION else UNKNOWN
        assert framer.received(before, 0.0, damaged=True) == []
        assert framer.missing == 0
        assert hear(framer, encode(UNIT, answer)) == [(UNIT, answer)]
        assert framer.heard_noise

    def test_the_next_request_knows_nothing_of_them(self):
        framer = asked()
        framer.received(b"\0", 0.0, damaged=True)
        framer.expect(UNIT, parse_request(QUESTION))
        assert hear(framer, GOOD) == [(UNIT, ANSWER)]
        assert not framer.heard_noise
