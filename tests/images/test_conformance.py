"""The cases of tests/vectors/conformance-tcp.json that are about PDUs for unit 10, asked of an image without any TCP.

Those about the framing around a PDU, and about other units, need a whole gateway.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.images.image import Image
from gateway.modbus.codes import Area
from images.asking import UNIT, exchange, image

_CASES = json.loads((Path(__file__).parents[1] / "vectors" / "conformance-tcp.json").read_text())["cases"]
_HEADER = 7


def _fixture() -> Image:
    """`U10` of the vector file."""
    bits, registers = ((0, 2047),), ((0, 255),)
    initial = {Area.HOLDING: ((0, tuple(range(256))),), Area.INPUT: ((0, tuple(range(1000, 1256))),)}
    return image(coils=bits, discrete=bits, holding=registers, input=registers, initial=initial)


def _adus(data: bytes) -> Iterator[bytes]:
    """The well-formed ADUs for unit 10 that `data` consists of; ValueError when it is anything else."""
    while data:
        size = 6 + int.from_bytes(data[4:6], "big")
        if len(data) < size or size <= _HEADER or data[2:4] != b"\0\0" or data[6] != UNIT:
            raise ValueError("no ADU for unit 10")
        yield data[:size]
        data = data[size:]


def _requests(case: dict) -> list[bytes]:
    """The request ADUs of a case about PDUs, none for a case about something else."""
    if case["expect"]["type"] not in {"exact", "oneof"}:
        return []
    try:
        return [adu for text in case["send"] for adu in _adus(bytes.fromhex(text))]
    except ValueError:
        return []


def _response(image: Image, adu: bytes) -> bytes:
    pdu = exchange(image, adu[_HEADER:])
    return adu[:4] + (len(pdu) + 1).to_bytes(2, "big") + adu[6:_HEADER] + pdu


_PDU_CASES = [case for case in _CASES if _requests(case)]


@pytest.mark.parametrize("case", _PDU_CASES, ids=lambda case: case["id"])
def test_an_image_answers_as_the_case_expects(case):
    image = _fixture()
    heard = b"".join(_response(image, adu) for adu in _requests(case)).hex()
    expected = case["expect"]["hex"]
    assert heard in (expected if isinstance(expected, list) else [expected])


def test_only_cases_about_framing_and_routes_are_left_out():
    left_out = {case["id"] for case in _CASES if case not in _PDU_CASES}
    framing = {"T03", "T04", "T05", "T06", "T08", "T09", "T10", "T13", "T14", "T57"}
    other_units = {"T59", "T61", "T62", "T63", "T64", "T65"}
    assert left_out == framing | other_units
