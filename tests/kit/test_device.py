import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from kit.device import Answer, SimulatedDevice, SimulatedLine


def ask(device: SimulatedDevice, pdu: str) -> str:
    (answer,) = SimulatedLine("rtu", device).received(rtu.encode(device.unit, bytes.fromhex(pdu)))
    response = answer.data[1:-2]
    assert answer == Answer(device.delay, rtu.encode(device.unit, response))
    return response.hex(" ").upper()


@pytest.fixture
def device():
    device = SimulatedDevice(unit=17, delay=0.02)
    device.coils[1:10] = device.discrete[1:10] = [True, False, True, True, False, False, True, True, True]
    device.holding[:3] = device.input[:3] = [0x0102, 0x0304, 0x0506]
    return device


def test_it_reads_bits_and_registers(device):
    assert ask(device, "01 00 01 00 09") == "01 02 CD 01"
    assert ask(device, "02 00 01 00 09") == "02 02 CD 01"
    assert ask(device, "03 00 00 00 02") == "03 04 01 02 03 04"
    assert ask(device, "04 00 01 00 02") == "04 04 03 04 05 06"


def test_it_writes_bits(device):
    assert ask(device, "05 00 05 FF 00") == "05 00 05 FF 00"
    assert ask(device, "0F 00 06 00 02 01 02") == "0F 00 06 00 02"
    assert device.coils[5:9] == [True, False, True, True]


def test_it_writes_registers(device):
    assert ask(device, "06 00 00 AB CD") == "06 00 00 AB CD"
    assert ask(device, "10 00 01 00 02 04 11 11 00 12") == "10 00 01 00 02"
    assert ask(device, "16 00 02 00 F2 00 25") == "16 00 02 00 F2 00 25"
    assert device.holding[:3] == [0xABCD, 0x1111, 0x0017]  # the mask example of A 6.16


def test_it_writes_before_it_reads(device):
    assert ask(device, "17 00 00 00 02 00 01 00 01 02 BE EF") == "17 04 01 02 BE EF"


def test_it_refuses_what_it_does_not_have(device):
    assert ask(device, "41") == "C1 01"
    assert ask(device, "03 00 C8 00 01") == "83 02"
    assert ask(device, "03 00 00 00 7E") == "83 03"
    device.refuses[3] = 6
    assert ask(device, "03 00 00 00 01") == "83 06"


def test_a_broadcast_is_acted_on_and_not_answered(device):
    other = SimulatedDevice(unit=18)
    assert SimulatedLine("rtu", device, other).received(rtu.encode(0, bytes.fromhex("06 00 00 00 07"))) == []
    assert device.holding[0] == other.holding[0] == 7


def test_a_transducer_answers_at_address_0_from_its_own_address():
    device = SimulatedDevice(unit=1)
    device.answers_unit_0 = True
    (answer,) = SimulatedLine("rtu", device).received(rtu.encode(0, bytes.fromhex("03 00 10 00 01")))
    assert answer.data == rtu.encode(1, bytes.fromhex("03 02 00 00"))


def test_a_script_is_answered_once_and_to_the_letter(device):
    line, request = SimulatedLine("rtu", device), rtu.encode(17, bytes.fromhex("03 00 00 00 01"))
    device.script += [[Answer(0.1, b"\x00"), (0.2, b"\xff")], []]
    assert line.received(request) == [Answer(0.1, b"\x00"), Answer(0.2, b"\xff")]
    assert line.received(request) == []
    assert line.received(request) == [Answer(0.02, rtu.encode(17, bytes.fromhex("03 02 01 02")))]
    assert len(device.heard) == 3


def test_a_silent_device_hears(device):
    device.silent = True
    assert SimulatedLine("rtu", device).received(rtu.encode(17, b"\x41")) == []
    assert device.heard == [(17, b"\x41")]


def test_a_device_that_is_not_asked_says_nothing(device):
    assert SimulatedLine("rtu", device).received(rtu.encode(3, bytes.fromhex("03 00 00 00 01"))) == []


def test_it_speaks_ascii(device):
    request = ascii_framing.encode(17, bytes.fromhex("03 00 00 00 01"))
    assert SimulatedLine("ascii", device).received(request) == [Answer(0.02, b":110302010" + b"2E7\r\n")]
