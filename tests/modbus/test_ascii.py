from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.ascii import AsciiFramer, encode, lrc
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import parse_request
from kit.noise import chunkings, noise
from kit.vectors import ANSWER, QUESTION, UNIT, broken, exchanges, meaning, seed_frames

GOOD = encode(UNIT, ANSWER)
#: Noise of a line with seven data bits, without what means something in ASCII framing.
NOISE = bytes(byte & 0x7F for byte in noise(40)).translate(None, b":\r\n")


def hear(framer: AsciiFramer, *chunks: bytes, at: float = 0.0) -> list[Frame]:
    return [frame for chunk in chunks for frame in framer.received(chunk, at)]


@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
class TestVectors:
    def test_encodes(self, exchange):
        assert encode(UNIT, exchange.request.pdu) == exchange.request.ascii
        assert encode(UNIT, exchange.response.pdu) == exchange.response.ascii

    def test_decodes_in_any_chunks(self, exchange):
        for wire in (exchange.request, exchange.response):
            for chunks in chunkings(wire.ascii):
                framer = AsciiFramer()
                assert hear(framer, *chunks) == [(UNIT, wire.pdu)]
                assert not framer.heard_noise

    def test_decodes_between_noise(self, exchange):
        for wire in (exchange.request, exchange.response):
            for around in (NOISE, b"\xff\x00", b"\r\n", wire.ascii[:-3]):
                framer = AsciiFramer()
                assert hear(framer, around + wire.ascii + around) == [(UNIT, wire.pdu)]
                assert framer.heard_noise


@pytest.mark.parametrize("frame", [frame for frame in seed_frames() if frame.mode == "ascii"], ids=meaning)
def test_printed_frames_are_heard(frame):
    (heard,) = hear(AsciiFramer(), frame.data)
    assert encode(*heard) == frame.data


@pytest.mark.parametrize("vector", broken("ascii"), ids=meaning)
def test_broken_and_foreign_frames_are_no_response(vector):
    for chunks in chunkings(vector.data):
        framer = AsciiFramer()
        frames = hear(framer, *chunks)
        assert (framer.behind > 0) is not bool(frames)
        if vector.rejected_by == "check":
            assert frames == []
        assert not any(unit == UNIT and parse_request(QUESTION).accepts(pdu) for unit, pdu in frames)


@pytest.mark.parametrize("vector", broken("ascii"), ids=meaning)
def test_a_good_response_behind_a_broken_one_is_found(vector):
    assert hear(AsciiFramer(), vector.data + GOOD)[-1] == (UNIT, ANSWER)


def test_glued_frames_are_all_heard():
    frames = [(unit, QUESTION) for unit in range(1, 100)]
    assert hear(AsciiFramer(), b"".join(encode(*frame) for frame in frames)) == frames


def test_a_colon_always_starts_anew():
    framer = AsciiFramer()
    assert hear(framer, GOOD[:10], GOOD) == [(UNIT, ANSWER)]
    assert framer.heard_noise


def test_a_gap_below_a_second_is_part_of_the_frame():
    framer = AsciiFramer()
    assert hear(framer, GOOD[:7], at=10.0) == []
    assert hear(framer, GOOD[7:], at=10.9) == [(UNIT, ANSWER)]
    assert not framer.heard_noise


def test_a_gap_above_a_second_drops_the_frame():
    framer = AsciiFramer()
    assert hear(framer, GOOD[:7], at=10.0) == []
    assert hear(framer, GOOD[7:], at=11.1) == []
    assert framer.heard_noise
    assert hear(framer, GOOD, at=11.1) == [(UNIT, ANSWER)]


def test_the_gap_counts_between_characters_not_over_the_frame():
    framer = AsciiFramer()
    frames = [frame for at, byte in enumerate(GOOD) for frame in framer.received(bytes((byte,)), 0.9 * at)]
    assert frames == [(UNIT, ANSWER)]


def test_silence_between_frames_is_no_noise():
    framer = AsciiFramer()
    hear(framer, GOOD, at=1.0)
    assert hear(framer, GOOD, at=100.0) == [(UNIT, ANSWER)]
    assert not framer.heard_noise


def test_digits_are_sent_in_upper_case():
    assert encode(0xAB, b"\xcd\xef") == b":ABCDEF99\r\n"


def test_lower_case_digits_are_accepted():
    assert hear(AsciiFramer(), GOOD.lower()) == [(UNIT, ANSWER)]


def test_a_parity_bit_in_bit_7_is_ignored():
    """Seven data bits with parity, heard through a port that is set to eight data bits."""
    even_parity = bytes(byte | (byte.bit_count() % 2) << 7 for byte in GOOD)
    assert even_parity != GOOD
    assert (
        hear(AsciiFramer(), even_parity) == hear(AsciiFramer(), bytes(byte | 0x80 for byte in GOOD)) == [(UNIT, ANSWER)]
    )


def test_the_longest_frame_has_513_characters():
    pdu = b"\x41" + noise(252)
    assert len(encode(UNIT, pdu)) == 513
    assert hear(AsciiFramer(), encode(UNIT, pdu)) == [(UNIT, pdu)]


def test_a_longer_frame_is_noise():
    framer = AsciiFramer()
    assert hear(framer, encode(UNIT, bytes(254))) == []
    assert framer.heard_noise


def test_endless_noise_is_not_kept():
    for start in (b"", b":"):
        framer = AsciiFramer()
        framer.received(start, 0.0)
        for _ in range(100):
            framer.received(b"0" * 512, 0.0)
            assert len(framer._cutter.begun) <= 513
        assert framer.heard_noise


def test_time_alone_ends_nothing():
    framer = AsciiFramer()
    hear(framer, GOOD[:-1])
    assert framer.deadline() is None
    assert framer.tick(100.0) == []


@given(st.integers(0, 255), st.binary(min_size=1, max_size=253), st.integers(0, 513))
def test_whatever_is_encoded_is_decoded_in_any_cut(unit, pdu, cut):
    data = encode(unit, pdu)
    assert hear(AsciiFramer(), data[:cut], data[cut:]) == [(unit, pdu)]


@given(st.lists(st.binary(max_size=600) | st.text(":0123456789ABCDEFabcdef\r\n ").map(str.encode)))
def test_garbage_raises_nothing_and_comes_out_the_same_in_any_cut(chunks):
    whole, cut = AsciiFramer(), AsciiFramer()
    frames = hear(cut, *(bytes((byte,)) for chunk in chunks for byte in chunk))
    assert hear(whole, b"".join(chunks)) == frames
    assert all(1 <= len(frame.pdu) <= 253 for frame in frames)


class TestDamaged:
    """At least one of some characters is not what was sent, whatever the LRC says."""

    @staticmethod
    def hear(framer: AsciiFramer, data: bytes, start: int, end: int) -> list[Frame]:
        frames = framer.received(data[:start], 0.0) + framer.received(data[start:end], 0.0, damaged=True)
        return frames + framer.received(data[end:], 0.0)

    def test_no_frame_has_all_of_them_in_it(self):
        for start, end in combinations(range(len(GOOD) + 1), 2):
            framer = AsciiFramer()
            assert self.hear(framer, GOOD, start, end) == []
            assert framer.behind > 0

    @pytest.mark.parametrize("end", range(1, len(GOOD) + 1))
    def test_it_may_have_been_the_glitch_before_a_frame(self, end):
        assert self.hear(AsciiFramer(), b"\x7f" + GOOD, 0, end) == [(UNIT, ANSWER)]

    @pytest.mark.parametrize("start", range(len(GOOD)))
    def test_it_may_have_been_the_glitch_behind_a_frame(self, start):
        assert self.hear(AsciiFramer(), GOOD + b"\x7f", start, len(GOOD) + 1) == [(UNIT, ANSWER)]

    def test_each_of_them_is_noise_once(self):
        framer = AsciiFramer()
        framer.received(b"\x7f\x7e\x7d", 0.0, damaged=True)
        assert framer.behind == 3

    def test_the_frame_behind_them_is_found(self):
        framer = AsciiFramer()
        framer.received(GOOD[:-1], 0.0, damaged=True)
        assert framer.received(GOOD, 0.0) == [(UNIT, ANSWER)]
        assert framer.heard_noise


@pytest.mark.parametrize("at", range(1, len(GOOD)))
def test_a_nul_between_characters_spoils_the_frame(at):
    assert hear(AsciiFramer(), GOOD[:at] + b"\0" + GOOD[at:]) == []


@pytest.mark.parametrize(
    ("data", "value"),
    [
        pytest.param("02 03 00 1D", 0xDE, id="example of the Mint application note"),
        pytest.param("", 0x00, id="nothing"),
        pytest.param("80 80", 0x00, id="the sum wraps"),
        pytest.param("FF FF", 0x02, id="two's complement"),
    ],
)
def test_lrc(data, value):
    assert lrc(bytes.fromhex(data)) == value


@given(st.binary(max_size=254))
def test_the_sum_over_data_and_lrc_is_zero(data):
    assert (sum(data) + lrc(data)) % 256 == 0
