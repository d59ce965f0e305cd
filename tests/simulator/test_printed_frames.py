"""Every request printed in the manufacturers' documents brings exactly the printed response."""

from itertools import pairwise

import pytest

from gateway.simulator.device import Device
from gateway.simulator.mint import Mint
from gateway.simulator.v80 import V80
from gateway.simulator.weigher import Weigher
from kit.vectors import SeedFrame, meaning, seed_frames
from simulator.playing import ascii_line, ask, rtu_line

#: The V80 document's examples; unit 1, 5 and address 0 are the transducer's.
PLC_UNITS = {6, 17}

EXCHANGES = [
    pytest.param(request, response.data, id=request.meaning)
    for request, response in pairwise(seed_frames())
    if (request.kind, response.kind) == ("request", "response")
]
OF_CONTROLLERS = [exchange for exchange in EXCHANGES if exchange.values[0].data[0] in PLC_UNITS]
OF_THE_WEIGHER = [exchange for exchange in EXCHANGES if exchange not in OF_CONTROLLERS]


def fresh_device(request: SeedFrame) -> Device:
    unit = request.data[0]
    return V80(unit) if unit in PLC_UNITS else Weigher(unit or 1, baud=9600)


@pytest.mark.parametrize(("request_", "response"), EXCHANGES)
def test_a_fresh_device_answers_as_printed(request_, response):
    assert ask(rtu_line(fresh_device(request_)), request_.data) == response


def test_a_line_of_controllers_answers_the_whole_document_as_printed():
    line = rtu_line(V80(6), V80(17))
    for turn, exchange in enumerate(OF_CONTROLLERS):
        request, response = exchange.values
        assert ask(line, request.data, at=float(turn)) == response


def test_one_weigher_answers_the_whole_document_as_printed():
    """Whoever asks must follow each change of the rate."""
    line, baud = rtu_line(Weigher(1, baud=9600)), 9600
    for turn, exchange in enumerate(OF_THE_WEIGHER):
        request, response = exchange.values
        assert ask(line, request.data, at=float(turn), baud=baud) == response
        baud = {"unit 1: set 19200 baud": 19200, "unit 1: set 9600 baud": 9600}.get(request.meaning, baud)


@pytest.mark.parametrize("frame", [frame for frame in seed_frames() if frame.mode == "ascii"], ids=meaning)
def test_the_fragment_that_shows_the_lrc_is_refused_as_too_short(frame):
    assert ask(ascii_line(Mint(2)), frame.data) == b":02830378\r\n"
