"""Against pymodbus, which knows nothing of us: what it encodes we read, what we encode it reads, byte for byte."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerAscii, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu import bit_message as bits
from pymodbus.pdu import register_message as registers

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span, exception_response, parse_request
from gateway.registers.items import pack_bits, unpack_bits
from kit.asked import Asked

ADDRESSES = st.integers(0, 0xFFFF)
WORDS = st.integers(0, 0xFFFF)
UNITS = st.integers(1, 247)


def words(most: int) -> st.SearchStrategy[list[int]]:
    return st.lists(WORDS, min_size=1, max_size=most)


def booleans(most: int) -> st.SearchStrategy[list[bool]]:
    return st.lists(st.booleans(), min_size=1, max_size=most)


def pdu(message: ModbusPDU) -> bytes:
    return bytes((message.function_code,)) + message.encode()


#: Request, response, what it reads, what it writes.
Exchange = tuple[ModbusPDU, ModbusPDU, Span | None, Span | None]


def reading_bits(request: type, response: type, area: Area) -> st.SearchStrategy[Exchange]:
    return st.builds(
        lambda at, values: (
            request(address=at, count=len(values)),
            response(bits=values),
            Span(area, at, len(values)),
            None,
        ),
        ADDRESSES,
        booleans(2000),
    )


def reading_registers(request: type, response: type, area: Area) -> st.SearchStrategy[Exchange]:
    return st.builds(
        lambda at, values: (
            request(address=at, count=len(values)),
            response(registers=values),
            Span(area, at, len(values)),
            None,
        ),
        ADDRESSES,
        words(125),
    )


def writing(request: type, response: type, area: Area, key: str, values: st.SearchStrategy) -> st.SearchStrategy:
    """A write whose response echoes address and value, or address and quantity."""
    return st.builds(
        lambda at, values: (
            request(address=at, **{key: values}),
            response(address=at, count=len(values), **{key: values}),
            None,
            Span(area, at, len(values)),
        ),
        ADDRESSES,
        values,
    )


EXCHANGES = {
    1: reading_bits(bits.ReadCoilsRequest, bits.ReadCoilsResponse, Area.COILS),
    2: reading_bits(bits.ReadDiscreteInputsRequest, bits.ReadDiscreteInputsResponse, Area.DISCRETE),
    3: reading_registers(registers.ReadHoldingRegistersRequest, registers.ReadHoldingRegistersResponse, Area.HOLDING),
    4: reading_registers(registers.ReadInputRegistersRequest, registers.ReadInputRegistersResponse, Area.INPUT),
    5: writing(bits.WriteSingleCoilRequest, bits.WriteSingleCoilResponse, Area.COILS, "bits", booleans(1)),
    6: writing(
        registers.WriteSingleRegisterRequest,
        registers.WriteSingleRegisterResponse,
        Area.HOLDING,
        "registers",
        words(1),
    ),
    15: st.builds(
        lambda at, values: (
            bits.WriteMultipleCoilsRequest(address=at, bits=values),
            bits.WriteMultipleCoilsResponse(address=at, count=len(values)),
            None,
            Span(Area.COILS, at, len(values)),
        ),
        ADDRESSES,
        booleans(1968),
    ),
    16: writing(
        registers.WriteMultipleRegistersRequest,
        registers.WriteMultipleRegistersResponse,
        Area.HOLDING,
        "registers",
        words(123),
    ),
    22: st.builds(
        lambda at, and_mask, or_mask: (
            registers.MaskWriteRegisterRequest(at, and_mask, or_mask),
            registers.MaskWriteRegisterResponse(at, and_mask, or_mask),
            None,
            Span(Area.HOLDING, at, 1),
        ),
        ADDRESSES,
        WORDS,
        WORDS,
    ),
    23: st.builds(
        lambda at, read, to, written: (
            registers.ReadWriteMultipleRegistersRequest(at, len(read), to, written),
            registers.ReadWriteMultipleRegistersResponse(registers=read),
            Span(Area.HOLDING, at, len(read)),
            Span(Area.HOLDING, to, len(written)),
        ),
        ADDRESSES,
        words(125),
        ADDRESSES,
        words(121),
    ),
}
ANY_EXCHANGE = st.one_of(EXCHANGES.values())


@pytest.mark.parametrize("function", EXCHANGES)
@given(data=st.data())
def test_we_read_what_it_asks_and_accept_what_it_answers(function, data):
    request, response, reads, writes = data.draw(EXCHANGES[function])
    asked = parse_request(pdu(request))
    assert (asked.function, asked.read, asked.write) == (function, reads, writes)
    assert asked.response_size == len(pdu(response))
    assert asked.accepts(pdu(response))


@given(ANY_EXCHANGE, st.integers(1, 11))
def test_exceptions_are_the_same(exchange, code):
    request = pdu(exchange[0])
    refusal = exception_response(request[0], code)
    assert refusal == pdu(ExceptionResponse(request[0], code))
    assert parse_request(request).accepts(refusal)


@given(booleans(2000))
def test_bits_are_packed_the_same(values):
    ours = pack_bits(bytes(values))
    assert bits.ReadCoilsResponse(bits=values).encode() == bytes((len(ours),)) + ours
    its = bits.ReadCoilsResponse()
    its.decode(bytes((len(ours),)) + ours)
    assert bytes(its.bits[: len(values)]) == unpack_bits(ours, len(values)) == bytes(values)


@given(UNITS, ANY_EXCHANGE)
def test_rtu(unit, exchange):
    request, response = pdu(exchange[0]), pdu(exchange[1])
    its = FramerRTU(DecodePDU(is_server=False))
    for message in (request, response):
        assert rtu.encode(unit, message) == its.encode(message, unit, 0)
    size, its_unit, _, its_pdu = its.decode(rtu.encode(unit, response))
    assert (size, its_unit, its_pdu) == (len(response) + 3, unit, response)
    assert rtu.RtuFramer(0.002).received(its.encode(request, unit, 0), 0.0) == [(unit, request)]
    framer = Asked(unit, parse_request(request))
    assert framer.received(its.encode(response, unit, 0), 0.0) == [(unit, response)]


@given(UNITS, ANY_EXCHANGE)
def test_ascii(unit, exchange):
    its = FramerAscii(DecodePDU(is_server=False))
    for message in (pdu(exchange[0]), pdu(exchange[1])):
        ours = ascii_framing.encode(unit, message)
        assert ours == its.encode(message, unit, 0)
        assert its.decode(ours) == (len(ours), unit, 0, message)
        assert ascii_framing.AsciiFramer().received(ours, 0.0) == [(unit, message)]


@given(WORDS, UNITS, ANY_EXCHANGE)
def test_tcp(transaction, unit, exchange):
    its = FramerSocket(DecodePDU(is_server=False))
    for message in (pdu(exchange[0]), pdu(exchange[1])):
        ours = mbap.encode(transaction, unit, message)
        assert ours == its.encode(message, unit, transaction)
        assert its.decode(ours) == (len(ours), unit, transaction, message)
        framer = mbap.MbapFramer()
        framer.room()[: len(ours)] = ours
        framer.filled(len(ours))
        assert framer.next() == (transaction, unit, message)
