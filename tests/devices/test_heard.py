"""A device of a monitor line: what it counts and keeps of what was heard, and that it is never asked."""

import pytest

from gateway.devices.device import DeviceSettings
from gateway.devices.heard import HeardDevice
from gateway.lines.last_reads import LastReads
from gateway.lines.monitor.monitor import HeardTransaction
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import parse_request
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from kit.asker import Asker

READ = "03 0000 0002"
TWO = "03 04 0001 0002"


@pytest.fixture
def device():
    settings = DeviceSettings("boiler", 3, 63, Profile("generic"), AnswerTime(TimingTable(), 1.5, 1.0))
    device = HeardDevice(settings, line_name="old-plc")
    device.last_reads = LastReads()
    return device


def hears(device: HeardDevice, asked: str, response: str | None, at: float, *, sure: bool = True) -> None:
    frame = None if response is None else Frame(3, bytes.fromhex(response))
    device.heard(HeardTransaction(3, parse_request(bytes.fromhex(asked)), frame, at, at + 0.1, sure), at + 0.1)


def kept(device: HeardDevice) -> list[tuple[str, str, bool]]:
    return [(str(each.span.addresses), each.response.hex(), each.outdated) for each in device.last_reads.of(3)]


def test_the_answer_to_a_read_is_kept_if_it_is_sure(device):
    hears(device, READ, TWO, 1.0, sure=False)
    assert kept(device) == []
    hears(device, READ, TWO, 2.0)
    assert kept(device) == [("0-1", "030400010002", False)]


@pytest.mark.parametrize(
    ("asked", "response", "sure", "outdated"),
    [
        ("06 0000 0001", "06 0000 0001", True, True),
        ("06 0000 0001", "06 0000 0001", False, True),
        ("06 0000 0001", None, False, True),
        ("06 0000 0001", "86 04", True, True),
        ("06 0000 0001", "86 02", True, False),
        ("06 0002 0001", "06 0002 0001", True, False),
        ("03 0000 0001", None, False, False),
    ],
)
def test_a_write_that_may_have_been_carried_out_outdates_what_is_kept(device, asked, response, sure, outdated):
    hears(device, READ, TWO, 1.0)
    hears(device, asked, response, 2.0, sure=sure)
    assert kept(device)[0] == ("0-1", "030400010002", outdated)


def test_what_was_heard_is_counted(device):
    hears(device, READ, TWO, 1.0)
    hears(device, READ, "83 02", 2.0)
    hears(device, READ, None, 3.0)
    counts = device.counts[3]
    assert (counts.sent, counts.responses, counts.ok, counts.exception, counts.timeout) == (3, 2, 1, 1, 1)


def test_who_wants_its_values_is_told_of_all(device):
    told = []
    device.take = lambda transaction, now: told.append((transaction.asked.function, transaction.is_sure, now))
    hears(device, READ, TWO, 1.0, sure=False)
    hears(device, "06 0000 0001", None, 2.0)
    assert told == [(3, False, 1.1), (6, True, 2.1)]


@pytest.mark.parametrize("pdu", ["03 0000 0001", "06 0000 0001", "2B 0E 01 00", "64"])
def test_every_request_is_answered_0a(device, pdu):
    asker = Asker()
    device.submit(asker.ask(pdu, unit=63), 1.0)
    assert asker.answers == [f"{int(pdu[:2], 16) | 0x80:02X} 0A"]
