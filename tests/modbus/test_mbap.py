import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.errors import NotModbus
from gateway.modbus.mbap import MbapFramer, TcpFrame, decode, encode
from kit.noise import chunkings
from kit.vectors import TRANSACTION, UNIT, exchanges, meaning

READ = bytes.fromhex("03 00 6B 00 03")


def feed(framer: MbapFramer, data: bytes) -> list[TcpFrame]:
    """Receive `data` as a connection does: as much as there is room for, then take what is complete."""
    frames = []
    while data:
        room = framer.room()
        count = min(len(room), len(data))
        room[:count] = data[:count]
        framer.filled(count)
        data = data[count:]
        while (frame := framer.next()) is not None:
            frames.append(frame)
    return frames


def hear(*chunks: bytes) -> list[TcpFrame]:
    framer = MbapFramer()
    return [frame for chunk in chunks for frame in feed(framer, chunk)]


@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
class TestVectors:
    def test_encodes(self, exchange):
        assert encode(TRANSACTION, UNIT, exchange.request.pdu) == exchange.request.tcp
        assert encode(TRANSACTION, UNIT, exchange.response.pdu) == exchange.response.tcp

    def test_decodes_in_any_chunks(self, exchange):
        for wire in (exchange.request, exchange.response):
            for chunks in chunkings(wire.tcp):
                assert hear(*chunks) == [(TRANSACTION, UNIT, wire.pdu)]

    def test_decodes_with_bytes_behind(self, exchange):
        framer = MbapFramer()
        data = exchange.response.tcp + exchange.request.tcp[:-1]
        assert feed(framer, data) == [(TRANSACTION, UNIT, exchange.response.pdu)]
        assert framer.unfinished == len(exchange.request.tcp) - 1
        assert feed(framer, exchange.request.tcp[-1:]) == [(TRANSACTION, UNIT, exchange.request.pdu)]
        assert framer.unfinished == 0


def test_the_longest_adu_has_260_bytes():
    pdu = bytes(253)
    assert len(encode(1, 2, pdu)) == 260
    assert hear(encode(1, 2, pdu)) == [(1, 2, pdu)]


def test_the_shortest_adu_is_a_function_code():
    assert hear(encode(0xFFFF, 255, b"\x07")) == [(0xFFFF, 255, b"\x07")]


@pytest.mark.parametrize("length", [0, 1, 255, 256, 65535])
def test_an_impossible_length_is_not_modbus(length):
    with pytest.raises(NotModbus, match=f"length of {length};"):
        hear(bytes.fromhex("0001 0000") + length.to_bytes(2, "big"))


def test_adus_before_an_impossible_length_are_heard():
    framer = MbapFramer()
    room = framer.room()
    data = encode(1, 2, READ) + bytes(6)
    room[: len(data)] = data
    framer.filled(len(data))
    assert framer.next() == (1, 2, READ)
    for _ in range(2):  # the stream stays lost
        with pytest.raises(NotModbus):
            framer.next()


@pytest.mark.parametrize(
    "hello",
    [
        pytest.param(bytes.fromhex("16 03 01 02 00 01 00 01 FC 03 03"), id="TLS client hello of 512 bytes"),
        pytest.param(bytes.fromhex("16 03 01 00 F5 01 00 00 F1 03 03"), id="TLS client hello of 245 bytes"),
        pytest.param(b"GET / HTTP/1.1\r\n", id="HTTP GET"),
        pytest.param(b"POST /api HTTP/1.1\r\n", id="HTTP POST"),
        pytest.param(b"SSH-2.0-OpenSSH_9.2\r\n", id="SSH"),
    ],
)
def test_other_protocols_are_not_modbus(hello):
    with pytest.raises(NotModbus):
        hear(hello)


def test_an_adu_of_another_protocol_identifier_is_passed_over():
    foreign = bytes.fromhex("0001 0001 0006 11 03 006B 0003")
    for chunks in chunkings(foreign + encode(2, UNIT, READ) + foreign):
        assert hear(*chunks) == [(2, UNIT, READ)]


def test_a_burst_of_64_reads_fits_the_buffer():
    burst = b"".join(encode(transaction, UNIT, READ) for transaction in range(64))
    assert len(burst) <= len(MbapFramer().room())
    assert hear(burst) == [(transaction, UNIT, READ) for transaction in range(64)]


def test_there_is_no_room_while_adus_fill_the_buffer():
    framer = MbapFramer()
    framer.filled(len(framer.room()))
    assert len(framer.room()) == 0


def test_the_buffer_never_grows():
    framer = MbapFramer()
    size = len(framer.room())
    for _ in range(100):
        feed(framer, encode(1, UNIT, READ) * 3 + encode(1, UNIT, READ)[:7])
        feed(framer, encode(1, UNIT, READ)[7:])
        assert len(framer.room()) == size


def test_a_frame_shows_its_bytes():
    assert repr(TcpFrame(7, 17, READ)) == "<TcpFrame transaction=7 unit=17 03 00 6B 00 03>"


FRAMES = st.tuples(st.integers(0, 0xFFFF), st.integers(0, 255), st.binary(min_size=1, max_size=253))


@given(st.lists(FRAMES, max_size=10), st.integers(1, 300))
def test_whatever_is_encoded_is_decoded_in_any_cut(frames, size):
    data = b"".join(encode(*frame) for frame in frames)
    assert hear(*(data[at : at + size] for at in range(0, len(data), size))) == frames


@given(st.lists(st.binary(max_size=300)))
def test_garbage_raises_not_modbus_or_nothing(chunks):
    try:
        frames = hear(*chunks)
    except NotModbus:
        return
    assert all(1 <= len(frame.pdu) <= 253 for frame in frames)


@pytest.mark.parametrize("size", [1, 5, 300, 5000])
def test_a_stream_is_cut_however_it_comes(size: int) -> None:
    adus = [(number, 17, bytes(range(1, 2 + number % 250))) for number in range(100)]
    stream = b"".join(encode(*adu) for adu in adus)
    framer = MbapFramer()
    assert [adu for at in range(0, len(stream), size) for adu in framer.cut(stream[at : at + size])] == adus


def test_a_strict_framer_does_not_pass_over_other_protocols() -> None:
    framer = MbapFramer(strict=True)
    with pytest.raises(NotModbus, match="a protocol identifier of 2"):
        list(framer.cut(bytes.fromhex("0001 0002 0002 11 03")))


@pytest.mark.parametrize(
    ("datagram", "frame"),
    [
        pytest.param("00 07 00 00 00 03 11 03 01", TcpFrame(7, 17, b"\x03\x01"), id="one ADU"),
        pytest.param("00 07 00 00 00 02 11 03", TcpFrame(7, 17, b"\x03"), id="the shortest"),
        pytest.param("00 07 00 01 00 03 11 03 01", None, id="another protocol"),
        pytest.param("00 07 00 00 00 03 11 03", None, id="cut"),
        pytest.param("00 07 00 00 00 03 11 03 01 00", None, id="more than one ADU"),
        pytest.param("00 07 00 00 00 01 11", None, id="no function code"),
        pytest.param("", None, id="nothing"),
    ],
)
def test_a_datagram_is_one_adu(datagram, frame):
    assert decode(bytes.fromhex(datagram)) == frame


def test_the_longest_adu_in_a_datagram():
    assert decode(encode(7, 17, bytes(253))) == TcpFrame(7, 17, bytes(253))
    assert decode(encode(7, 17, bytes(254))) is None
