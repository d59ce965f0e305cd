"""Functions 17 and 43/14 of an image: who it is."""

import pytest

from gateway.images.services import Identity
from gateway.modbus.codes import MAX_PDU
from gateway.modbus.pdu import parse_request
from gateway.version import __version__
from images.asking import image

VENDOR, PRODUCT, NAME = b"modbus-gateway", b"register image", b"shift-data"
REVISION = __version__.encode()


def identify(pdu: str, name: str = "shift-data") -> tuple[bytes, dict[int, bytes]]:
    """The head of the response, and its objects."""
    asked = bytes.fromhex(pdu)
    response = Identity(name).identify(asked)
    assert parse_request(asked).accepts(response)
    assert len(response) <= MAX_PDU
    objects, at = {}, 7
    while at < len(response):
        objects[response[at]] = response[at + 2 : at + 2 + response[at + 1]]
        at += 2 + response[at + 1]
    return response[:7], objects


def test_it_reports_its_name_and_that_it_runs():
    assert Identity("shift-data").report(b"\x11") == b"\x11\x0bshift-data\xff"


def test_an_image_is_called_as_in_the_config():
    assert image()._services[17](b"\x11") == b"\x11\x0bshift-data\xff"


def test_the_basic_objects():
    head, objects = identify("2B 0E 01 00")
    assert head.hex(" ").upper() == "2B 0E 01 82 00 00 03"
    assert objects == {0: VENDOR, 1: PRODUCT, 2: REVISION}


@pytest.mark.parametrize("code", ["02", "03"])
def test_the_regular_objects_and_no_more_than_those(code):
    head, objects = identify(f"2B 0E {code} 00")
    assert head.hex(" ").upper() == f"2B 0E {code} 82 00 00 04"
    assert objects == {0: VENDOR, 1: PRODUCT, 2: REVISION, 6: NAME}


def test_a_stream_begins_where_it_is_asked_to():
    assert identify("2B 0E 01 02")[1] == {2: REVISION}
    assert identify("2B 0E 02 02")[1] == {2: REVISION, 6: NAME}


@pytest.mark.parametrize("pdu", ["2B 0E 01 03", "2B 0E 01 06", "2B 0E 02 03", "2B 0E 03 80"])
def test_a_stream_from_an_object_that_is_not_among_them_begins_with_the_first(pdu):
    assert 0 in identify(pdu)[1]


@pytest.mark.parametrize(("number", "value"), [(0, VENDOR), (1, PRODUCT), (2, REVISION), (6, NAME)])
def test_one_object(number, value):
    head, objects = identify(f"2B 0E 04 {number:02X}")
    assert head.hex(" ").upper() == "2B 0E 04 82 00 00 01"
    assert objects == {number: value}


def test_what_does_not_fit_follows():
    head, objects = identify("2B 0E 02 00", "x" * 244)
    assert head.hex(" ").upper() == "2B 0E 02 82 FF 06 03"
    assert objects == {0: VENDOR, 1: PRODUCT, 2: REVISION}
    head, objects = identify("2B 0E 02 06", "x" * 244)
    assert head.hex(" ").upper() == "2B 0E 02 82 00 00 01"
    assert objects == {6: b"x" * 244}


def test_a_name_that_no_response_can_hold_is_cut():
    assert identify("2B 0E 04 06", "x" * 300)[1] == {6: b"x" * 244}
    assert len(Identity("x" * 300).report(b"\x11")) <= MAX_PDU


def test_what_is_not_ascii_in_a_name_is_replaced():
    assert identify("2B 0E 04 06", "Förderband")[1] == {6: b"F?rderband"}
