import pytest

from gateway.modbus.functions import request_size, response_size
from kit.vectors import exchanges, meaning

REQUESTS = [exchange for exchange in exchanges() if exchange.request_tells_size]
#: Those whose response tells its size itself, not only the request.
RESPONSES = [exchange for exchange in REQUESTS if exchange.response_tells_size]


def foretold_from_the_first_bytes_and_never_too_large(foretell, pdu):
    wanted = [foretell(pdu[:size]) for size in range(len(pdu) + 1)]
    assert wanted == sorted(wanted)
    assert all(size < want <= len(pdu) for size, want in enumerate(wanted[:-1]))
    assert wanted[-1] == foretell(pdu + b"more") == len(pdu)


@pytest.mark.parametrize("exchange", REQUESTS, ids=meaning)
def test_the_size_of_a_request(exchange):
    foretold_from_the_first_bytes_and_never_too_large(request_size, exchange.request.pdu)


@pytest.mark.parametrize("exchange", RESPONSES, ids=meaning)
def test_the_size_of_a_response(exchange):
    foretold_from_the_first_bytes_and_never_too_large(response_size, exchange.response.pdu)


@pytest.mark.parametrize("foretell", [request_size, response_size])
@pytest.mark.parametrize("head", ["00", "41 01 02", "64", "09", "08 00 00 A5 37", "08 00 15 00", "2B 0D 01 02"])
def test_what_only_silence_ends(foretell, head):
    assert foretell(bytes.fromhex(head)) == 0


@pytest.mark.parametrize("function", [1, 3, 7, 43, 65, 127])
def test_an_exception_has_two_bytes(function):
    assert response_size(bytes((function | 0x80,))) == 2


def test_a_byte_count_of_two_bytes_counts_with_both():
    assert response_size(bytes.fromhex("18 01 02")) == 3 + 0x0102
