"""The functions that read and write no table: what is passed on, and what is taken for an answer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.errors import IllegalAddress, IllegalValue
from gateway.modbus.functions import FUNCTIONS, TABLE_FUNCTIONS, response_size
from gateway.modbus.pdu import parse_request
from kit.vectors import exchanges, meaning

SERVICES = [each for each in exchanges() if each.request.pdu[0] not in TABLE_FUNCTIONS]


def asked(pdu: str):
    return parse_request(bytes.fromhex(pdu))


@pytest.mark.parametrize(
    ("pdu", "response"),
    [
        ("07", "08 6D"),
        ("08 0000 A537", "08 0000 A538"),
        ("08 0000 A537", "08 0000 A5"),
        ("08 000B 0000", "08 000C 0005"),
        ("08 000B 0000", "08 000B 0005 00"),
        ("08 000A 0000", "08 000A 0001"),
        ("08 0001 FF00", "08 0001 0000"),
        ("08 0002 0000", "08 0000 0000"),
        ("08 0015 0003", "08 0016 0003"),
        ("0B", "0B 0000 01"),
        ("0C", "0C 08 0000 0108 0121 20"),
        ("0C", "0C 08 0000 0108 0121 20 00 00"),
        ("0C", "0C 05 0000 0108 01"),
        ("0C", "0C 47 0000 0108 0121" + "40" * 65),
        ("11", "11 05 0F 01 FF 63"),
        ("11", "11"),
        ("14 07 06 0004 0001 0002", "14 05 05 06 0DFE 0020"),
        ("14 07 06 0004 0001 0002", "14 06 05 07 0DFE 0020"),
        ("14 07 06 0004 0001 0002", "14 06 03 06 0DFE 0020"),
        ("14 0E 06 0004 0001 0002 06 0003 0009 0002", "14 0C 05 06 0DFE 0020 03 06 33CD 0040"),
        ("14 0E 06 0004 0001 0002 06 0003 0009 0002", "14 0C 05 06 0DFE 0020 05 05 33CD 0040"),
        ("14 0E 06 0004 0001 0002 06 0003 0009 0002", "14 06 05 06 0DFE 0020"),
        ("15 09 06 0004 0007 0001 06AF", "15 09 06 0004 0007 0001 06AE"),
        ("18 04DE", "18 0006 0002 01B8"),
        ("18 04DE", "18 0006 0001 01B8 1284"),
        ("18 04DE", "18 0002 0000 01B8"),
        ("18 04DE", "18 0001 00"),
        ("18 04DE", "18 0042 0020" + "0000" * 32),
        ("2B 0E 01 00", "2B 0D 01 01 00 00 01 00 01 41"),
        ("2B 0E 01 00", "2B 0E 02 01 00 00 01 00 01 41"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00 02 00 01 41"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00 01 00 01 41 42"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00 01 00 FF" + "41" * 255),
        ("2B 0E 04 02", "2B 0E 04 81 00 00 01 01 01 41"),
        ("2B 0E 04 02", "2B 0E 04 81 00 00 02 02 01 41 03 01 41"),
        ("2B 0D 00", "2B 0C 00"),
    ],
)
def test_what_is_no_answer_is_not_accepted(pdu, response):
    assert not asked(pdu).accepts(bytes.fromhex(response))


@pytest.mark.parametrize("exchange", SERVICES, ids=meaning)
def test_no_answer_fits_another_function(exchange):
    for other in SERVICES:
        if other.request.pdu[0] != exchange.request.pdu[0]:
            assert not parse_request(other.request.pdu).accepts(exchange.response.pdu)


def test_sub_functions_and_types_of_manufacturers_pass_to_devices_as_they_are():
    for pdu in ("08 0015", "08 0015 03", "08 FFFF 0000 0000", "2B 0D", "2B 00 01", "2B FF" + "00" * 251):
        request = asked(pdu)
        assert (request.response_size, request.longest_response) == (None, 0)
        assert request.accepts(request.response_head + b"whatever")


def test_records_are_counted():
    assert asked("14 0E 06 0004 0001 0002 06 0003 0009 0003").items == 5
    assert asked("15 0D 06 0004 0007 0003 06AF 04BE 100D").items == 3
    assert asked("18 04DE").items == 31
    assert asked("0C").items == asked("08 0000 A537").items == asked("2B 0E 01 00").items == 0


@pytest.mark.parametrize(
    ("pdu", "longest"),
    [
        ("07", 2),
        ("08 0000" + "A537" * 125, 253),
        ("08 000B 0000", 5),
        ("0B", 5),
        ("0C", 72),
        ("11", 253),
        ("14 07 06 0004 0001 007C", 252),
        ("14 F5" + "06 0004 0001 0002" * 35, 212),
        ("14 0E 06 0004 0001 003E 06 0004 0001 003D", 252),
        ("15 FB 06 0004 0007 007A" + "0000" * 122, 253),
        ("18 04DE", 67),
        ("2B 0E 01 00", 253),
        ("2B 0D 00", 0),
    ],
)
def test_the_longest_response(pdu, longest):
    assert asked(pdu).longest_response == longest


@given(st.sampled_from([each.request.pdu for each in SERVICES]), st.binary(max_size=260))
def test_an_answer_has_the_size_that_was_foretold(pdu, data):
    request = parse_request(pdu)
    for response in (data, request.response_head + data, pdu[:1] + bytes((len(data) & 0xFF,)) + data):
        if request.accepts(response) and request.longest_response and response[0] < 0x80:
            assert len(response) <= request.longest_response
            assert request.response_size in {None, len(response)}
            assert response_size(response) in {0, len(response)}


@given(st.sampled_from(sorted(FUNCTIONS.keys() - TABLE_FUNCTIONS)), st.binary(max_size=255))
def test_any_request_is_refused_or_its_response_is_foretold(function, data):
    try:
        request = parse_request(bytes((function,)) + data)
    except (IllegalAddress, IllegalValue):
        return
    assert request.response_head[0] == function
    assert max(request.longest_response, len(request.response_head)) <= 253
