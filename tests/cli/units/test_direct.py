"""A unit that is asked without a gateway gets each request as it is."""

import argparse

import pytest

from gateway.cli.units.direct import DirectUnit, _Place
from gateway.cli.units.unit import NoResponseError
from gateway.operator.values.steps import Step


class Echo:
    """A client of pymodbus that answers with these bytes; `sent` is what it was given."""

    def __init__(self, answer: str) -> None:
        self.sent: list[str] = []
        self.function_code, *rest = bytes.fromhex(answer)
        self._rest = bytes(rest)

    def execute(self, _no_response, request):
        assert request.dev_id == 3
        self.sent.append(bytes((request.function_code, *request.encode())).hex(" ").upper())
        return self

    def encode(self) -> bytes:
        return self._rest


def asked(request: str, answer: str, wide=()) -> tuple[list[str], bytes]:
    client = Echo(answer)
    place = _Place(argparse.Namespace(mode=None, tcp="there", timeout=None))
    place.wide = dict(wide)
    unit = DirectUnit(client, 3, (), place)
    return client.sent, unit.ask(Step(bytes.fromhex(request))).pdu


@pytest.mark.parametrize(
    ("request_pdu", "response"),
    [
        ("03 00 08 00 01", "03 02 A5 70"),
        ("16 00 08 FF F7 00 08", "16 00 08 FF F7 00 08"),
        ("10 00 08 00 01 02 A5 7F", "10 00 08 00 01"),
        ("05 00 03 FF 00", "05 00 03 FF 00"),
    ],
)
def test_a_request_is_sent_as_it_is(request_pdu, response):
    sent, answer = asked(request_pdu, response)
    assert (sent, answer) == ([request_pdu], bytes.fromhex(response))


@pytest.mark.parametrize(
    ("request_pdu", "response"),
    [
        ("03 13 88 00 02", "03 08 00 01 11 70 00 01 11 71"),
        ("10 13 88 00 01 04 00 01 11 70", "10 13 88 00 01"),
    ],
)
def test_registers_of_four_bytes_have_four_in_both_directions(request_pdu, response):
    wide = {"holding": ((5000, 5999),)}
    assert asked(request_pdu, response, wide) == ([request_pdu], bytes.fromhex(response))
    with pytest.raises(NoResponseError, match="this is not the response"):
        asked("03 13 88 00 02", "03 04 00 01 11 70", wide)


def test_a_response_that_does_not_fit_is_none():
    with pytest.raises(NoResponseError, match="this is not the response to this request: 03 04"):
        asked("03 00 08 00 01", "03 04 A5 70 00 00")
