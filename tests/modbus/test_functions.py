"""The table of functions: each row against requests and responses that are put together here, field by field."""

from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.errors import IllegalValue
from gateway.modbus.codes import Area
from gateway.modbus.functions import (
    BROADCAST_FUNCTIONS,
    FUNCTIONS,
    KNOWN_FUNCTIONS,
    READERS,
    READING_FUNCTIONS,
    TABLE_FUNCTIONS,
    only_reads,
    request_size,
    response_size,
)
from gateway.modbus.pdu import Span, exception_response, parse_request

#: A number from the first to the last of two.
Draw = Callable[[int, int], int]

COILS, DISCRETE, HOLDING, INPUT = Area.COILS, Area.DISCRETE, Area.HOLDING, Area.INPUT

#: Sub-functions of 08 that change nothing: the diagnostic register and the counters. They need the right to write.
INSPECTED = {bytes((0, each)) for each in (0x02, *range(0x0B, 0x13))}


class Exchange(NamedTuple):
    """A request behind its function code, its response likewise, what is read and written, and how much."""

    request: bytes
    response: bytes
    reads: Span | None = None
    writes: Span | None = None
    items: int = 0
    values: bytes = b""


def word(number: int) -> bytes:
    return number.to_bytes(2, "big")


def some(draw: Draw, size: int) -> bytes:
    return bytes(draw(0, 255) for _ in range(min(size, 3))).ljust(size, b"\xa5")


def counted(data: bytes) -> bytes:
    return bytes((len(data),)) + data


def reading(area: Area, most: int, bits: int) -> Callable[[Draw], Exchange]:
    def exchange(draw: Draw) -> Exchange:
        start, count = draw(0, 65535), draw(1, most)
        response = counted(some(draw, (bits * count + 7) // 8))
        return Exchange(word(start) + word(count), response, Span(area, start, count), None, count)

    return exchange


def writing(area: Area, most: int, bits: int) -> Callable[[Draw], Exchange]:
    def exchange(draw: Draw) -> Exchange:
        start, count = draw(0, 65535), draw(1, most)
        head, values = word(start) + word(count), some(draw, (bits * count + 7) // 8)
        return Exchange(head + counted(values), head, None, Span(area, start, count), count, values)

    return exchange


def write_coil(draw: Draw) -> Exchange:
    start = draw(0, 65535)
    request = word(start) + word(0xFF00 * draw(0, 1))
    return Exchange(request, request, None, Span(COILS, start, 1), 1)


def write_register(draw: Draw) -> Exchange:
    start, value = draw(0, 65535), some(draw, 2)
    return Exchange(word(start) + value, word(start) + value, None, Span(HOLDING, start, 1), 1, value)


def mask_register(draw: Draw) -> Exchange:
    start = draw(0, 65535)
    request = word(start) + some(draw, 4)
    return Exchange(request, request, None, Span(HOLDING, start, 1), 1)


def write_and_read(draw: Draw) -> Exchange:
    start, count, start_written, written = draw(0, 65535), draw(1, 125), draw(0, 65535), draw(1, 121)
    values = some(draw, 2 * written)
    return Exchange(
        word(start) + word(count) + word(start_written) + word(written) + counted(values),
        counted(some(draw, 2 * count)),
        Span(HOLDING, start, count),
        Span(HOLDING, start_written, written),
        max(count, written),
        values,
    )


def bare(size: int) -> Callable[[Draw], Exchange]:
    return lambda draw: Exchange(b"", some(draw, size))


def echo(draw: Draw) -> Exchange:
    data = word(0) + some(draw, 2 * draw(1, 125))
    return Exchange(data, data)


def one_word(sub_function: int, *, repeats: bool = True) -> Callable[[Draw], Exchange]:
    def exchange(draw: Draw) -> Exchange:
        value = word(sub_function) + some(draw, 2)
        return Exchange(value if repeats else word(sub_function) + word(0), value)

    return exchange


def event_log(draw: Draw) -> Exchange:
    return Exchange(b"", counted(some(draw, 6 + draw(0, 64))))


def server_id(draw: Draw) -> Exchange:
    return Exchange(b"", counted(some(draw, draw(0, 251))))


def record(draw: Draw) -> bytes:
    return b"\6" + word(draw(0, 65535)) + word(draw(0, 9999))


def read_files(draw: Draw) -> Exchange:
    counts = [draw(1, 40) for _ in range(draw(1, 3))]
    request = b"".join(record(draw) + word(count) for count in counts)
    response = b"".join(counted(b"\6" + some(draw, 2 * count)) for count in counts)
    return Exchange(counted(request), counted(response), items=sum(counts))


def write_files(draw: Draw) -> Exchange:
    counts = [draw(1, 30) for _ in range(draw(1, 3))]
    request = counted(b"".join(record(draw) + word(count) + some(draw, 2 * count) for count in counts))
    return Exchange(request, request, items=sum(counts))


def read_queue(draw: Draw) -> Exchange:
    count = draw(0, 31)
    return Exchange(some(draw, 2), word(2 + 2 * count) + word(count) + some(draw, 2 * count), items=31)


def identify(draw: Draw) -> Exchange:
    code, first = bytes((14, draw(1, 3))), draw(0, 255)
    objects = [bytes((draw(0, 255),)) + counted(some(draw, draw(0, 40))) for _ in range(draw(0, 5))]
    response = code + bytes((0x82, 0, 0, len(objects))) + b"".join(objects)
    return Exchange(code + bytes((first,)), response)


def identify_one(draw: Draw) -> Exchange:
    first = draw(0, 255)
    value = counted(some(draw, draw(0, 244)))
    return Exchange(bytes((14, 4, first)), bytes((14, 4, 0x82, 0, 0, 1, first)) + value)


class Known(NamedTuple):
    """What the specification says of a function: in `section`; r, w, or b for a write that may be broadcast."""

    function: int
    section: str
    effect: str
    exchange: Callable[[Draw], Exchange]
    #: Whether their own first bytes tell the sizes of request and response.
    tells: tuple[bool, bool] = (True, True)


KNOWN = [
    Known(1, "6.1", "r", reading(COILS, 2000, 1)),
    Known(2, "6.2", "r", reading(DISCRETE, 2000, 1)),
    Known(3, "6.3", "r", reading(HOLDING, 125, 16)),
    Known(4, "6.4", "r", reading(INPUT, 125, 16)),
    Known(5, "6.5", "b", write_coil),
    Known(6, "6.6", "b", write_register),
    Known(7, "6.7", "r", bare(1)),
    Known(8, "6.8", "w", echo, (False, False)),
    *(Known(8, "6.8", "w", one_word(each)) for each in (1, 3, 4, 10, 20)),
    *(Known(8, "6.8", "w", one_word(each, repeats=False)) for each in (2, *range(11, 19))),
    Known(11, "6.9", "r", bare(4)),
    Known(12, "6.10", "r", event_log),
    Known(15, "6.11", "b", writing(COILS, 1968, 1)),
    Known(16, "6.12", "b", writing(HOLDING, 123, 16)),
    Known(17, "6.13", "r", server_id),
    Known(20, "6.14", "r", read_files),
    Known(21, "6.15", "w", write_files),
    Known(22, "6.16", "b", mask_register),
    Known(23, "6.17", "w", write_and_read),
    Known(24, "6.18", "r", read_queue),
    Known(43, "6.19", "r", identify),
    Known(43, "6.19", "r", identify_one),
]

each_function = pytest.mark.parametrize("known", KNOWN, ids=lambda known: f"{known.function} {known.section}")
few = settings(max_examples=25)


def put_together(known: Known, data: st.DataObject) -> Exchange:
    exchange = known.exchange(lambda first, last: data.draw(st.integers(first, last)))
    code = bytes((known.function,))
    return exchange._replace(request=code + exchange.request, response=code + exchange.response)


def foretold(size_of: Callable[[bytes], int], pdu: bytes, *, tells: bool) -> bool:
    """Whether the size is right, and never said to be more before the PDU is whole."""
    said = [size_of(pdu[:size]) for size in range(len(pdu) + 1)]
    if not tells:
        return said[-1] == 0
    return said == sorted(said) and all(size < more for size, more in enumerate(said[:-1])) and said[-1] == len(pdu)


def test_every_row_is_tested_and_has_its_source():
    assert {row.code: row.section for row in FUNCTIONS.values()} == {each.function: each.section for each in KNOWN}
    parts = {begin: part.section for row in FUNCTIONS.values() for begin, part in row.parts.items()}
    sub_functions = (0, 1, 2, 3, 4, 10, *range(11, 19), 20)
    assert parts == dict.fromkeys((bytes((8, 0, each)) for each in sub_functions), "6.8.1") | {b"\x2b\x0e": "6.21"}


@each_function
@few
@given(data=st.data())
def test_each_request_and_its_response_follow_the_table(known, data):
    exchange = put_together(known, data)
    check_that_a_request_tells_its_size_and_what_it_reads_and_writes(known, exchange)
    check_that_the_size_of_a_response_is_foretold(known, exchange)
    check_that_only_a_response_of_that_size_is_accepted(known, exchange)
    check_that_a_request_of_another_size_is_refused(exchange)


def check_that_a_request_tells_its_size_and_what_it_reads_and_writes(known: Known, exchange: Exchange) -> None:
    assert foretold(request_size, exchange.request, tells=known.tells[0])
    asked = parse_request(exchange.request)
    assert (asked.read, asked.write, asked.items) == (exchange.reads, exchange.writes, exchange.items)
    assert asked.values == exchange.values
    assert only_reads(exchange.request) == (known.effect == "r")
    is_inspected = exchange.request[0] == 8 and exchange.request[1:3] in INSPECTED
    assert asked.only_reads == (known.effect == "r" or is_inspected)
    assert asked.is_answered == (not exchange.request.startswith(b"\x08\0\4"))


def check_that_the_size_of_a_response_is_foretold(known: Known, exchange: Exchange) -> None:
    assert foretold(response_size, exchange.response, tells=known.tells[1])
    asked = parse_request(exchange.request)
    assert asked.response_size in {None, len(exchange.response)}
    assert len(exchange.response) <= asked.longest_response <= 253
    assert exchange.response.startswith(asked.response_head)


def check_that_only_a_response_of_that_size_is_accepted(known: Known, exchange: Exchange) -> None:
    asked = parse_request(exchange.request)
    assert asked.accepts(exchange.response)
    assert asked.accepts(exception_response(known.function, 2))
    assert not asked.accepts(exchange.response[:-1])
    assert not asked.accepts(exchange.response + b"\0")


def check_that_a_request_of_another_size_is_refused(exchange: Exchange) -> None:
    for pdu in filter(None, (exchange.request[:-1], exchange.request + b"\0")):
        with pytest.raises(IllegalValue):
            parse_request(pdu)


def test_the_sets_of_functions_follow_from_the_table():
    assert {each.function for each in KNOWN} == KNOWN_FUNCTIONS
    assert {each.function for each in KNOWN if each.effect == "b"} == BROADCAST_FUNCTIONS
    assert {each.function for each in KNOWN if each.effect == "r"} - {43} == READING_FUNCTIONS
    assert {1, 2, 3, 4, 5, 6, 15, 16, 22, 23} == TABLE_FUNCTIONS
    assert {COILS: (1, 2000), DISCRETE: (2, 2000), HOLDING: (3, 125), INPUT: (4, 125)} == READERS


@pytest.mark.parametrize("function", range(1, 128))
def test_what_has_no_row_is_a_write_that_only_silence_ends(function):
    if function not in KNOWN_FUNCTIONS:
        assert request_size(bytes((function, 1))) == response_size(bytes((function, 1))) == 0
        assert not only_reads(bytes((function,)))


@pytest.mark.parametrize("code", range(128, 256))
def test_an_exception_response_has_two_bytes(code):
    assert response_size(bytes((code,))) == 2
    assert request_size(bytes((code,))) == 0
