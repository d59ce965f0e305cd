"""How many bytes must come before there can be a response: never more than are needed, whatever comes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.pdu import exception_response, parse_request
from kit.asked import Asked
from kit.vectors import ANSWER, QUESTION, UNIT, exchanges, meaning

MODES = ["rtu", "ascii"]
REFUSAL = exception_response(QUESTION[0], 2)


def asked(mode: str, pdu: bytes = QUESTION, unit: int | None = UNIT) -> Asked:
    return Asked(unit, parse_request(pdu), mode)


def encoded(mode: str, pdu: bytes) -> bytes:
    return (ascii_framing if mode == "ascii" else rtu).encode(UNIT, pdu)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("exchange", exchanges(), ids=meaning)
def test_it_is_never_more_than_is_still_to_come(exchange, mode):
    for pdu in (exchange.response.pdu, exception_response(exchange.request.pdu[0], 2)):
        adu = encoded(mode, pdu)
        for come in range(len(adu)):
            framer = asked(mode, exchange.request.pdu)
            assert framer.received(adu[:come], 0.0) == []
            assert framer.missing <= len(adu) - come


@pytest.mark.parametrize("mode", MODES)
@given(data=st.data())
def test_nothing_is_found_before_whatever_comes(mode, data):
    pieces = [encoded(mode, pdu) for pdu in (ANSWER, REFUSAL, QUESTION)]
    piece = st.one_of(
        st.binary(max_size=4), *(st.just(adu[:size]) for adu in pieces for size in range(1, len(adu) + 1))
    )
    before, behind = (
        data.draw(st.lists(piece, max_size=4)),
        b"".join(data.draw(st.lists(piece, min_size=4, max_size=8))),
    )
    framer = asked(mode)
    for chunk in before:
        framer.received(chunk, 0.0)
    missing = framer.missing
    frames = framer.received(behind[: max(0, missing - 1)], 0.0)
    found = [frame.pdu for frame in frames if parse_request(QUESTION).accepts(frame.pdu)]
    # Behind noise that began like the response a whole exception response may come sooner: it is read a little later.
    assert [pdu for pdu in found if pdu != REFUSAL or missing <= len(encoded(mode, REFUSAL))] == []


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("pdu", "unit"), [(b"\x41\x01", UNIT), (QUESTION, None)])
def test_it_is_not_known_for_long_when_size_or_unit_are_not(mode, pdu, unit):
    framer = asked(mode, pdu, unit)
    framer.received(encoded(mode, b"\x41" + bytes(20))[:20], 0.0)
    assert framer.missing == 0


@pytest.mark.parametrize("mode", MODES)
def test_nothing_is_missing_of_what_has_not_begun(mode):
    assert asked(mode).missing == 0
