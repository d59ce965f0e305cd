"""The request framer: what a server hears on an RTU line that it may share with others."""

from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.frame import Frame
from gateway.modbus.functions import KNOWN_FUNCTIONS
from gateway.modbus.rtu import RtuFramer, crc16, crc_fits, encode, with_crc
from kit.noise import chunkings, flipped, noise, random_chunks
from kit.vectors import UNIT, exchanges, meaning, seed_frames

SILENCE = 0.002
READ = bytes.fromhex("03 00 6B 00 03")
LONGEST = bytes.fromhex("10 00 00 00 7B F6") + bytes(range(246))
KNOWN = [exchange for exchange in exchanges() if exchange.request_tells_size]
UNKNOWN = [exchange for exchange in exchanges() if not exchange.request_tells_size]


def hear(framer: RtuFramer, *chunks: bytes, at: float = 0.0) -> list[Frame]:
    """What comes of chunks that follow each other at once, and the silence behind them."""
    frames = [frame for chunk in chunks for frame in framer.received(chunk, at)]
    return frames + framer.tick(at + SILENCE)


@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
class TestVectors:
    def test_decodes_in_any_chunks(self, exchange):
        for chunks in chunkings(exchange.request.rtu):
            assert hear(RtuFramer(SILENCE), *chunks) == [(UNIT, exchange.request.pdu)]

    def test_decodes_behind_what_switching_the_line_leaves(self, exchange):
        for before in (b"\x00\xff", b"\xff", b"\x00\x00\x00"):
            assert hear(RtuFramer(SILENCE), before + exchange.request.rtu) == [(UNIT, exchange.request.pdu)]

    def test_behind_more_noise_a_request_must_be_known(self, exchange):
        for before in (b"\xff" + exchange.request.rtu[:-1], noise(100)):
            heard = hear(RtuFramer(SILENCE), before + exchange.request.rtu)
            assert heard == ([(UNIT, exchange.request.pdu)] if exchange.request_tells_size else [])

    def test_a_wrong_bit_makes_it_no_request(self, exchange):
        for bit in range(8 * len(exchange.request.rtu)):
            assert hear(RtuFramer(SILENCE), flipped(exchange.request.rtu, bit)) == []


@pytest.mark.parametrize("exchange", KNOWN, ids=meaning)
def test_a_known_request_ends_on_its_last_byte(exchange):
    framer = RtuFramer(SILENCE)
    assert framer.received(exchange.request.rtu[:-1], 0.0) == []
    assert framer.received(exchange.request.rtu[-1:], 0.0) == [(UNIT, exchange.request.pdu)]
    assert framer.deadline() is None


@pytest.mark.parametrize("exchange", KNOWN, ids=meaning)
def test_noise_behind_a_known_request_does_not_touch_it(exchange):
    for behind in (b"\x00", noise(3), noise(300)):
        framer = RtuFramer(SILENCE)
        assert framer.received(exchange.request.rtu + behind, 0.0) == [(UNIT, exchange.request.pdu)]
        assert framer.tick(SILENCE) == []


@pytest.mark.parametrize("exchange", UNKNOWN, ids=meaning)
def test_an_unknown_request_ends_by_silence(exchange):
    framer = RtuFramer(SILENCE)
    assert framer.received(exchange.request.rtu, 1.0) == []
    assert framer.deadline() == 1.0 + SILENCE
    assert framer.tick(1.0 + SILENCE / 2) == []
    assert framer.tick(1.0 + SILENCE) == [(UNIT, exchange.request.pdu)]
    assert framer.deadline() is None


@pytest.mark.parametrize("frame", [f for f in seed_frames() if f.mode == "rtu" and f.kind == "request"], ids=meaning)
def test_printed_requests_are_heard(frame):
    assert RtuFramer(SILENCE).received(frame.data, 0.0) == [(frame.data[0], frame.data[1:-2])]
    assert encode(frame.data[0], frame.data[1:-2]) == frame.data


def test_silence_drops_half_a_request():
    framer, data = RtuFramer(SILENCE), encode(UNIT, READ)
    assert hear(framer, data[:5]) == []
    assert hear(framer, data[5:], at=1.0) == []
    assert hear(framer, data, at=2.0) == [(UNIT, READ)]


def test_without_bytes_there_is_no_silence_to_wait_for():
    framer = RtuFramer(SILENCE)
    assert framer.deadline() is None
    assert framer.tick(100.0) == []


def test_glued_requests_are_all_heard():
    frames = [(unit, READ) for unit in range(1, 65)]
    data = b"".join(encode(*frame) for frame in frames)
    assert len(data) == 512
    assert RtuFramer(SILENCE).received(data, 0.0) == frames
    assert hear(RtuFramer(SILENCE), *random_chunks(data, seed=1)) == frames


def test_the_longest_requests_are_heard_behind_noise():
    assert hear(RtuFramer(SILENCE), b"\x00\xff\x00" + encode(UNIT, LONGEST)) == [(UNIT, LONGEST)]
    longest_unknown = b"\x41" + noise(252)
    assert hear(RtuFramer(SILENCE), b"\x00" + encode(UNIT, longest_unknown)) == [(UNIT, longest_unknown)]


def test_a_request_behind_more_noise_than_a_frame_holds_is_heard():
    data = noise(400) + encode(UNIT, READ) + noise(300, seed=1)
    assert hear(RtuFramer(SILENCE), data) == [(UNIT, READ)]
    assert hear(RtuFramer(SILENCE), *random_chunks(data)) == [(UNIT, READ)]


@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
def test_other_servers_responses_do_not_spoil_the_next_request(exchange):
    """On a shared line the responses of others are heard too, glued to the next request by the adapter."""
    other = encode(5, exchange.response.pdu)
    frames = hear(RtuFramer(SILENCE), other + encode(UNIT, READ))
    assert frames[-1] == (UNIT, READ)
    assert [frame for frame in frames if frame.unit == UNIT] == [(UNIT, READ)]


# --- a line with other servers ---

COILS_ASKED, COILS = bytes.fromhex("01 00 00 00 10"), bytes.fromhex("01 02 C6 9D")
TO_ALL = bytes.fromhex("06 00 01 00 05")


def test_a_response_of_another_server_ends_on_its_last_byte():
    framer = RtuFramer(SILENCE, ours={UNIT})
    write, written = bytes.fromhex("10 00 01 00 01 02 00 07"), bytes.fromhex("10 00 01 00 01")
    for unit, pdu in ((7, COILS_ASKED), (7, COILS), (7, write), (7, written), (UNIT, READ)):
        assert framer.received(encode(unit, pdu), 0.0) == [(unit, pdu)]


def test_a_response_behind_a_request_that_was_not_heard_ends_by_silence_at_the_latest():
    framer = RtuFramer(SILENCE, ours={UNIT})
    response = bytes.fromhex("10 00 01 00 02")
    assert hear(framer, encode(7, response) + encode(UNIT, READ)) == [(7, response), (UNIT, READ)]


def test_the_nul_that_begins_a_broadcast_is_no_part_of_the_response_before_it():
    """With a NUL behind it a frame still has a fitting check sum, and seven bytes become the eight of a request."""
    frames = [(7, COILS_ASKED), (7, COILS), (0, TO_ALL), (7, COILS_ASKED), (UNIT, READ)]
    stream = b"".join(encode(*frame) for frame in frames)
    for chunks in chunkings(stream):
        assert hear(RtuFramer(SILENCE, ours={UNIT}), *chunks) == frames


def test_a_request_that_begins_like_a_response_is_heard_whole():
    """Its CRC ends with 00, so its first seven bytes have a fitting check sum as well."""
    requests = (bytes((1, 2)) + at.to_bytes(1) + bytes((0, 1)) for at in range(256))
    request = next(pdu for pdu in requests if encode(7, pdu).endswith(b"\0"))
    for chunks in chunkings(encode(7, request)):
        assert hear(RtuFramer(SILENCE, ours={UNIT}), *chunks) == [(7, request)]


def test_endless_noise_is_not_kept():
    framer = RtuFramer(SILENCE)
    for _ in range(100):
        framer.received(noise(512), 0.0)
    assert len(framer._buffer) <= 256


@given(
    st.lists(st.tuples(st.integers(0, 255), st.sampled_from([e.request.pdu for e in KNOWN])), max_size=20), st.data()
)
def test_any_cut_gives_the_same_requests(frames, data):
    stream = b"".join(encode(*frame) for frame in frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)))))
    chunks = [stream[one:two] for one, two in pairwise([0, *cuts, len(stream)])]
    assert hear(RtuFramer(SILENCE), *chunks) == frames


@given(st.integers(0, 255), st.binary(min_size=1, max_size=253).filter(lambda pdu: pdu[0] not in KNOWN_FUNCTIONS))
def test_whatever_is_encoded_is_decoded(unit, pdu):
    assert hear(RtuFramer(SILENCE), encode(unit, pdu)) == [(unit, pdu)]


@pytest.mark.parametrize("pdu", ["03 00 00 00", "03 00 00 00 01 00", "0F 00 00 00 09 01 FF 01", "10 00 00 00 02 04 00"])
def test_a_request_of_a_wrong_size_ends_by_silence(pdu):
    """It is a whole frame with a fitting check sum, so it can be answered 03."""
    assert hear(RtuFramer(SILENCE), encode(UNIT, bytes.fromhex(pdu))) == [(UNIT, bytes.fromhex(pdu))]


@given(st.lists(st.binary(max_size=300)))
def test_garbage_raises_nothing(chunks):
    for frame in hear(RtuFramer(SILENCE), *chunks):
        assert 1 <= len(frame.pdu) <= 253


class TestDamaged:
    """At least one of some bytes is not what was sent, whatever the CRC says."""

    GOOD = encode(UNIT, READ)

    @staticmethod
    def hear(framer: RtuFramer, data: bytes, start: int, end: int) -> list[Frame]:
        frames = framer.received(data[:start], 0.0) + framer.received(data[start:end], 0.0, damaged=True)
        return frames + hear(framer, data[end:])

    def test_no_request_has_all_of_them_in_it(self):
        for start, end in combinations(range(len(self.GOOD) + 1), 2):
            framer = RtuFramer(SILENCE)
            assert self.hear(framer, self.GOOD, start, end) == []
            assert framer.heard_noise
            assert framer.behind == len(self.GOOD)

    @pytest.mark.parametrize("end", range(1, 10))
    def test_it_may_have_been_the_glitch_before_a_request(self, end):
        assert self.hear(RtuFramer(SILENCE), b"\xff" + self.GOOD, 0, end) == [(UNIT, READ)]

    @pytest.mark.parametrize("start", range(8))
    def test_it_may_have_been_the_glitch_behind_a_request(self, start):
        framer = RtuFramer(SILENCE)
        assert self.hear(framer, self.GOOD + b"\xff", start, 9) == [(UNIT, READ)]
        assert framer.behind == 1


def test_unit_0_never_responds_so_what_comes_from_it_is_read_as_a_request_only():
    response = bytes.fromhex("03 02 12 34")
    for unit, heard in ((9, [(9, response)]), (0, []), (5, [])):
        framer = RtuFramer(SILENCE, {5})
        assert framer.received(encode(unit, READ), 0.0) == [(unit, READ)]
        assert framer.received(encode(unit, response), 0.1) == heard


@pytest.mark.parametrize(("glitch", "is_heard"), [(3, True), (4, False)])
def test_so_many_bytes_of_noise_may_stand_before_a_request_that_only_silence_ends(glitch: int, is_heard: bool):
    pdu = b"\x41\x01"
    assert hear(RtuFramer(SILENCE), b"\xff" * glitch + encode(UNIT, pdu)) == ([(UNIT, pdu)] if is_heard else [])


def test_behind_a_frame_that_silence_ends_nothing_of_the_noise_before_it_counts():
    framer = RtuFramer(SILENCE)
    frame = encode(UNIT, bytes.fromhex("41 01 02"))
    assert hear(framer, b"\xff" + frame) == [(UNIT, frame[1:-2])]
    assert framer.behind == 0


def crc_of_the_specification(data: bytes) -> int:
    """Bit by bit, as S 6.2.2 describes it."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        pytest.param(b"123456789", 0x4B37, id="check value of CRC-16/MODBUS"),
        pytest.param(bytes.fromhex("02 07"), 0x1241, id="example of S 6.2.2"),
        pytest.param(b"", 0xFFFF, id="nothing"),
    ],
)
def test_crc(data, crc):
    assert crc16(data) == crc


def test_the_crc_goes_low_byte_first():
    assert with_crc(bytes.fromhex("02 07")) == bytes.fromhex("02 07 41 12")


@given(st.binary(max_size=260))
def test_the_crc_is_that_of_the_specification(data):
    assert crc16(data) == crc_of_the_specification(data)


@given(st.binary(min_size=1, max_size=254), st.integers(1, 255), st.data())
def test_a_crc_fits_its_data_and_no_data_with_a_wrong_byte(data, error, choice):
    frame = bytearray(with_crc(data))
    assert crc_fits(bytes(frame))
    frame[choice.draw(st.integers(0, len(frame) - 1))] ^= error
    assert not crc_fits(bytes(frame))
