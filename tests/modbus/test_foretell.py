import pytest

from gateway.modbus.foretell import request_size, response_size
from kit.vectors import exchanges, meaning


@pytest.mark.parametrize("exchange", [exchange for exchange in exchanges() if exchange.known], ids=meaning)
@pytest.mark.parametrize(("foretell", "side"), [(request_size, "request"), (response_size, "response")])
def test_a_size_is_foretold_from_the_first_bytes_and_never_too_large(exchange, foretell, side):
    pdu = getattr(exchange, side).pdu
    wanted = [foretell(pdu[:size]) for size in range(len(pdu) + 1)]
    assert wanted == sorted(wanted)
    assert all(size < want <= len(pdu) for size, want in enumerate(wanted[:-1]))
    assert wanted[-1] == foretell(pdu + b"more") == len(pdu)


@pytest.mark.parametrize("function", [0, 7, 8, 11, 20, 24, 43, 65, 100, 0x83, 255])
def test_the_size_of_an_unknown_request_is_not_foretold(function):
    assert request_size(bytes((function, 1, 2, 3))) == 0


@pytest.mark.parametrize("function", [0, 7, 8, 11, 20, 24, 43, 65, 100])
def test_the_size_of_an_unknown_response_is_not_foretold(function):
    assert response_size(bytes((function, 1, 2, 3))) == 0


@pytest.mark.parametrize("function", [1, 3, 7, 65, 127])
def test_an_exception_has_two_bytes(function):
    assert response_size(bytes((function | 0x80,))) == 2
