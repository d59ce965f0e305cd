"""Faults that cannot be detected are left out, so that the soak may say that every wrong answer is a lie."""

import pytest

from gateway.modbus import rtu
from gateway.modbus.rtu import crc_fits
from kit.faulty import Fault, FaultyDevice, FaultyLine
from kit.line_bench import TIMING

#: Of unit 3 with number 10: its response ends with a NUL, and is a whole frame without it.
REQUEST = rtu.encode(3, bytes.fromhex("41 02 AC 55"))
RESPONSE = rtu.encode(3, bytes.fromhex("41 0A 02 AC 55"))


@pytest.mark.parametrize("fault", [Fault.HALF_LATE, Fault.CUT])
def test_a_response_of_unknown_size_does_not_lose_only_its_nul(fault: Fault) -> None:
    assert RESPONSE.endswith(b"\0")
    assert crc_fits(RESPONSE[:-1])
    line = FaultyLine(TIMING, FaultyDevice(3, number=10), share=1.0, seed=1, faults={fault: 1.0})
    begun = {line.received(REQUEST, 100.0 * time)[0].data for time in range(1, 100)}
    assert line.injected[fault] > 50
    assert RESPONSE[:-2] in begun
    assert RESPONSE[:-1] not in begun
