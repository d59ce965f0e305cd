import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway import errors
from gateway.modbus.codes import Area
from gateway.modbus.functions import KNOWN_FUNCTIONS, request_size, response_size
from gateway.modbus.pdu import (
    RequestPdu,
    Span,
    exception_response,
    parse_request,
)
from kit.vectors import ANSWER, QUESTION, exchanges, malformed, meaning


@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
class TestVectors:
    def test_says_what_is_read_and_written(self, exchange):
        asked = parse_request(exchange.request.pdu)
        assert (asked.read, asked.write) == (exchange.reads, exchange.writes)
        assert asked.function == exchange.request.pdu[0]
        assert asked.data == exchange.request.pdu

    def test_accepts_its_response(self, exchange):
        assert parse_request(exchange.request.pdu).accepts(exchange.response.pdu)

    def test_foretells_its_response(self, exchange):
        asked, response = parse_request(exchange.request.pdu), exchange.response.pdu
        if response[0] >= 0x80:
            return
        assert asked.response_size in (None, len(response))
        assert bool(asked.longest_response) == exchange.response_tells_size
        assert response.startswith(asked.response_head)

    def test_accepts_no_response_of_another_size(self, exchange):
        asked = parse_request(exchange.request.pdu)
        if exchange.response_tells_size:
            assert not asked.accepts(exchange.response.pdu[:-1])
            assert not asked.accepts(exchange.response.pdu + b"\x00")


@pytest.mark.parametrize(("pdu", "error"), [pytest.param(*row[1:], id=row[0]) for row in malformed()])
def test_a_malformed_request_is_refused(pdu, error):
    with pytest.raises(errors.RequestError) as refused:
        parse_request(pdu)
    assert type(refused.value).__name__ == error


def test_a_refusal_shows_the_rule_and_the_bytes():
    with pytest.raises(errors.IllegalValue, match=r"^function 03: the quantity must be 1 to 125: 03 00 00 00 7E$"):
        parse_request(bytes.fromhex("03 00 00 00 7E"))


@pytest.mark.parametrize(
    ("pdu", "rule"),
    [
        ("03 00 00 00", "the length must be 5 bytes"),
        ("41" + 253 * "00", "the length must be 1 to 253 bytes"),
        ("14 06 06 00 04 00 07 00", "the byte count must be 7 to 245, and that of the bytes after it"),
        ("10 00 01 00 01 02 00 0A 00", "the byte count must be 0 to 247, and that of the bytes after it"),
        ("15 0A 06 00 04 00 07 00 02 06 AF", "the byte count must be 9 to 251, and that of the bytes after it"),
    ],
)
def test_a_refusal_says_which_lengths_there_are(pdu, rule):
    with pytest.raises(errors.IllegalValue) as refused:
        parse_request(bytes.fromhex(pdu))
    assert f": {rule}: " in str(refused.value)


@pytest.mark.parametrize(
    "pdu",
    [
        pytest.param(bytes.fromhex("01 00 00 07 D0"), id="2000 coils"),
        pytest.param(bytes.fromhex("02 00 00 07 D0"), id="2000 inputs"),
        pytest.param(bytes.fromhex("03 00 00 00 7D"), id="125 registers"),
        pytest.param(bytes.fromhex("04 00 00 00 7D"), id="125 input registers"),
        pytest.param(bytes.fromhex("0F 00 00 07 B0 F6") + bytes(246), id="write 1968 coils"),
        pytest.param(bytes.fromhex("10 00 00 00 7B F6") + bytes(246), id="write 123 registers"),
        pytest.param(bytes.fromhex("17 00 00 00 7D 00 00 00 79 F2") + bytes(242), id="read 125, write 121"),
    ],
)
def test_the_largest_quantities_pass_and_fit_a_pdu(pdu):
    asked = parse_request(pdu)
    assert len(pdu) <= 253
    assert asked.response_size <= 253


def test_items_are_the_larger_of_the_two_quantities():
    assert parse_request(bytes.fromhex("17 0003 0006 000E 0003 06 00FF 00FF 00FF")).items == 6
    assert parse_request(bytes.fromhex("17 0003 0001 000E 0003 06 00FF 00FF 00FF")).items == 3
    assert parse_request(b"\x41").items == 0


@pytest.mark.parametrize("function", sorted(set(range(1, 128)) - KNOWN_FUNCTIONS))
def test_an_unknown_function_passes_unchecked(function):
    asked = parse_request(bytes((function, 1, 2)))
    assert (asked.read, asked.write, asked.response_size) == (None, None, None)
    assert asked.response_head == bytes((function,))


def test_a_request_longer_than_a_pdu_is_refused():
    parse_request(b"\x41" + bytes(252))
    with pytest.raises(errors.IllegalValue):
        parse_request(b"\x41" + bytes(253))


@pytest.mark.parametrize(
    "response",
    [
        pytest.param("", id="nothing"),
        pytest.param("04" + ANSWER[1:].hex(), id="another function"),
        pytest.param("03 04 02 2B 00 00", id="fewer registers"),
        pytest.param("03 04 02 2B 00 00 00 64", id="a byte count that disagrees with the size"),
        pytest.param("84 02", id="the exception of another function"),
        pytest.param("83", id="an exception without a code"),
        pytest.param("83 02 00", id="an exception and a byte"),
    ],
)
def test_what_is_no_answer_is_not_accepted(response):
    assert not parse_request(QUESTION).accepts(bytes.fromhex(response))


@pytest.mark.parametrize(
    ("request_pdu", "repeated"),
    [
        ("05 00 AC FF 00", 5),
        ("06 00 01 00 03", 5),
        ("08 00 00 A5 37 00 01", 7),
        ("08 00 01 FF 00", 5),
        ("08 00 02 00 00", 3),
        ("08 00 0A 00 00", 5),
        ("08 00 0B 00 00", 3),
        ("0F 00 13 00 0A 02 CD 01", 5),
        ("10 00 01 00 02 04 00 0A 01 02", 5),
        ("15 0B 06 00 04 00 07 00 02 06 AF 04 BE", 13),
        ("16 00 04 00 F2 00 25", 7),
    ],
)
def test_a_response_repeats_so_much_of_its_request(request_pdu, repeated):
    asked = parse_request(bytes.fromhex(request_pdu))
    size = 5 if asked.function in {8, 15, 16} and repeated <= 5 else repeated
    for at in range(size):
        response = bytearray(asked.data[:size])
        assert asked.accepts(bytes(response))
        response[at] ^= 1
        assert asked.accepts(bytes(response)) == (at >= repeated)


def test_an_exception_response_has_bit_7_and_a_code():
    assert exception_response(3, errors.ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND) == b"\x83\x0b"


def test_a_request_shows_its_bytes():
    assert repr(parse_request(QUESTION)) == "<RequestPdu 03 00 6B 00 03>"


def test_a_span_ends_behind_its_last_item():
    assert Span(Area.COILS, 19, 10).end == 29


@given(
    st.one_of(
        st.binary(min_size=1, max_size=260),
        st.builds(
            bytes.__add__,
            st.sampled_from([bytes((function,)) for function in sorted(KNOWN_FUNCTIONS)]),
            st.binary(max_size=12),
        ),
    )
)
def test_any_bytes_are_refused_or_foretold(pdu):
    """Who parses a request and who cuts it out of a stream agree on all sizes."""
    try:
        asked: RequestPdu = parse_request(pdu)
    except errors.RequestError:
        return
    assert request_size(pdu) in {0, len(pdu)}
    assert request_size(pdu) or asked.function not in KNOWN_FUNCTIONS - {8, 43}
    if asked.response_size is not None and asked.function != 8:
        assert response_size(asked.response_head) == asked.response_size
    assert asked.accepts(exception_response(asked.function, 1))


@pytest.mark.parametrize(
    ("other", "has_one"),
    [
        (Span(Area.HOLDING, 5, 5), True),
        (Span(Area.HOLDING, 9, 3), True),
        (Span(Area.HOLDING, 6, 1), True),
        (Span(Area.HOLDING, 10, 3), False),
        (Span(Area.HOLDING, 2, 3), False),
        (Span(Area.INPUT, 5, 5), False),
    ],
)
def test_spans_touch_where_both_have_an_address(other, has_one):
    span = Span(Area.HOLDING, 5, 5)
    assert (span.touches(other), other.touches(span)) == (has_one, has_one)
