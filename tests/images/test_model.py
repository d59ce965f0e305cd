"""An image and the plain model of a unit agree on every request, and on what it leaves behind."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.images.image import Image
from gateway.modbus.codes import MAX_PDU, Area
from gateway.routing.broadcast import Broadcast, Recipient
from gateway.version import __version__
from images.asking import exchange, image
from images.model import Model

_RANGES = {
    Area.COILS: ((0, 40), (100, 2200)),
    Area.DISCRETE: ((3, 2100),),
    Area.INPUT: ((0, 200), (65530, 65535)),
    Area.HOLDING: ((1, 99), (101, 300), (65530, 65535)),
}


def _initial(address: int, area: Area) -> int:
    number = address * 40503 % 65536
    return number if area in {Area.INPUT, Area.HOLDING} else number >> 7 & 1


def _pair() -> tuple[Image, Model]:
    """An image and a model with the same items."""
    runs = {
        area: tuple((first, tuple(_initial(at, area) for at in range(first, last + 1))) for first, last in ranges)
        for area, ranges in _RANGES.items()
    }
    items = {
        area: {at + i: value for at, values in run for i, value in enumerate(values)} for area, run in runs.items()
    }
    objects = {0: b"modbus-gateway", 1: b"register image", 2: __version__.encode(), 6: b"shift-data"}
    return image(initial=runs, **_RANGES), Model(items, b"shift-data", objects)


_edges = st.sampled_from([0, 1, 3, 40, 41, 98, 99, 100, 101, 200, 300, 2100, 2200, 65530, 65534, 65535])
_words = st.integers(0, 65535)
_addresses = _edges | st.integers(0, 130) | _words
_functions = st.sampled_from([1, 2, 3, 4, 5, 6, 15, 16, 22, 23])


def _counts(most: int) -> st.SearchStrategy[int]:
    return st.integers(1, 12) | st.sampled_from([0, 1, most - 1, most, most + 1]) | st.integers(0, most)


def _pack(*words: int) -> bytes:
    return b"".join(word.to_bytes(2, "big") for word in words)


@st.composite
def _almost_valid(draw: st.DrawFn) -> bytes:
    """A request whose fields fit one another; addresses and quantities often do not fit the unit."""
    function, start = draw(_functions), draw(_addresses)
    head = bytes((function,)) + start.to_bytes(2, "big")
    if function in {1, 2}:
        return head + _pack(draw(_counts(2000)))
    if function in {3, 4}:
        return head + _pack(draw(_counts(125)))
    if function == 5:
        return head + _pack(draw(st.sampled_from([0xFF00, 0x0000]) | _words))
    if function == 6:
        return head + _pack(draw(_words))
    if function == 22:
        return head + _pack(draw(_words), draw(_words))
    if function == 23:
        head += _pack(draw(_counts(125)), draw(_addresses))
    count = draw(_counts({15: 1968, 16: 123, 23: 121}[function]))
    size = min((count + 7) // 8 if function == 15 else 2 * count, 255)
    seed = draw(st.binary(min_size=1, max_size=8))
    return head + _pack(count) + bytes((size,)) + (seed * size)[:size]


_no_items = st.one_of(
    st.sampled_from([b"\x07", b"\x0b", b"\x0c", b"\x11", b"\x18\x04\xde"]),
    st.builds(lambda sub, data: b"\x08" + _pack(sub, *data), st.integers(0, 24), st.lists(_words, max_size=3)),
    st.builds(lambda sub: b"\x08" + _pack(sub, 0), st.integers(0, 24)),
    st.builds(lambda code, number: bytes((43, 14, code, number)), st.integers(0, 5), st.integers(0, 8)),
)


@st.composite
def _spoilt(draw: st.DrawFn) -> bytes:
    """An almost valid request that was cut, lengthened, or changed in one byte."""
    pdu = bytearray(draw(_almost_valid() | _no_items))
    match draw(st.sampled_from(["cut", "lengthened", "changed"])):
        case "cut":
            del pdu[draw(st.integers(1, max(1, len(pdu) - 1))) :]
        case "lengthened":
            pdu += draw(st.binary(min_size=1, max_size=4))
        case _:
            pdu[draw(st.integers(0, len(pdu) - 1))] = draw(st.integers(0, 255))
    return bytes(pdu)


_garbage = st.binary(min_size=1, max_size=MAX_PDU)


@pytest.mark.search
@given(st.lists(_almost_valid() | _no_items | _spoilt() | _garbage, min_size=1, max_size=12))
@example([bytes.fromhex("08 0002 0001")])
def test_an_image_and_the_model_of_a_unit_agree(pdus):
    image, model = _pair()
    for pdu in pdus:
        assert exchange(image, pdu).hex(" ") == model.answer(pdu).hex(" "), pdu.hex(" ")
    for area, ranges in _RANGES.items():
        for first, last in ranges:
            left = image.tables[area].values(first, last + 1 - first)
            assert left == tuple(model.items[area][at] for at in range(first, last + 1))


@pytest.mark.search
@given(_garbage)
def test_whatever_comes_is_answered_exactly_once(pdu):
    image, _ = _pair()
    response = exchange(image, pdu)
    assert response[0] in {pdu[0], pdu[0] | 0x80}
    assert len(response) <= MAX_PDU


@pytest.mark.search
@given(_almost_valid() | _spoilt() | _garbage)
def test_a_broadcast_leaves_what_the_same_request_would_leave(pdu):
    addressed, _ = _pair()
    broadcasted, _ = _pair()
    untouched, _ = _pair()
    exchange(addressed, pdu)
    exchange(Broadcast([Recipient(broadcasted)]), pdu, unit=0)
    expected = addressed if pdu[0] in {5, 6, 15, 16, 22} else untouched
    for area, table in broadcasted.tables.items():
        for first, last in table.ranges:
            count = last + 1 - first
            assert table.values(first, count) == expected.tables[area].values(first, count)
