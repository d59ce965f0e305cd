"""A mirror on the clock: a defect in it stays in it."""

import asyncio

import pytest

from gateway.events import PartFailed
from gateway.images.drivers.polls_driver import Pollers
from gateway.images.drivers.unit_driver import UnitDriver
from gateway.images.mirror import Mirror
from gateway.images.polling import PolledUnit
from gateway.images.polls import MirrorSettings, Poll
from gateway.modbus.codes import Area
from gateway.profiles.holes import Holes
from gateway.profiles.profile import Profile
from gateway.profiles.read_rules import NO_RULES
from gateway.request import Target
from kit.asker import Asker


class BrokenDevice(Target):
    """A device whose check has a defect until it is mended; then it takes requests and never answers."""

    is_broken = True

    def __init__(self):
        self.asked = []
        self.holes = Holes()

    def submit(self, request, now, *, yields=False):
        if self.is_broken:
            raise ZeroDivisionError
        self.asked.append(request)

    def is_resting(self, now):
        return False


class RaisingDevice(Target):
    """A device that raises for what a client asks, before or after it has answered; `polls` are for the test."""

    def __init__(self, *, answers_first):
        self.polls = []
        self.holes = Holes()
        self._answers_first = answers_first

    def submit(self, request, now, *, yields=False):
        if yields:
            self.polls.append(request)
            return
        if self._answers_first:
            request.respond(request.pdu)
        raise ZeroDivisionError

    def is_resting(self, now):
        return False


def mirror_of(device, emit):
    polls = (Poll(Area.HOLDING, 0, 9, 0.5),)
    settings = MirrorSettings(241, "silo", "silo-1", Profile("a"), polls, {Area.HOLDING: ((0, 9),)}, 2.0, "g.toml:1")
    loop = asyncio.get_running_loop()
    polls = Pollers(loop, emit).of(device, PolledUnit("silo-1", 1, NO_RULES))
    return UnitDriver(lambda driver: Mirror(settings, polls.polls, device, driver, emit), {"silo-1": polls}, loop, emit)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("answers_first", "written"), [(True, "06 00 01 00 05"), (False, "86 04")], ids=["answered", "not answered"]
)
async def test_a_device_that_raises_is_counted_once_and_what_waits_behind_is_answered(answers_first, written):
    """The defect is met as a poll ends, so that nobody is in `submit` whose request could be failed instead."""
    events, device, client = [], RaisingDevice(answers_first=answers_first), Asker()
    driver = mirror_of(device, events.append)
    driver.start()
    await asyncio.sleep(0.1)
    for pdu in ("03 00 00 00 01", "06 00 01 00 05", "03 00 00 00 01"):
        driver.submit(client.ask(pdu, unit=241), asyncio.get_running_loop().time())
    values = bytes.fromhex("03 14") + bytes(20)
    device.polls.pop().respond(values)
    await asyncio.sleep(0.6)
    device.polls.pop().respond(values)
    assert client.answers == ["03 02 00 00", written, "03 02 00 00"]
    assert [type(event) for event in events] == [PartFailed]
    assert driver.unit._clients == {}
    driver.close()


@pytest.mark.interpreted
@pytest.mark.parametrize("pdu", ["06 00 01 00 05", "03 00 00 00 01"])
async def test_a_request_that_meets_a_defect_fails_and_the_next_one_goes_on(monkeypatch, pdu):
    events, device, client = [], BrokenDevice(), Asker()
    driver = mirror_of(device, events.append)
    with monkeypatch.context() as patched:
        patched.setattr(driver.unit, "_read", lambda *_: 1 // 0)
        driver.submit(client.ask(pdu, unit=241), 0.0)
    function = int(pdu[:2]) | 0x80
    assert client.answers == [f"{function:02X} 04"]
    assert [type(event) for event in events] == [PartFailed]
    device.is_broken = False
    driver.submit(client.ask("06 00 01 00 05", unit=241), 0.0)
    assert len(device.asked) == 1
    device.asked[0].respond(bytes.fromhex("06 00 01 00 05"))
    assert client.answers[1:] == ["06 00 01 00 05"]
    assert driver.unit._clients == {}
    driver.close()


@pytest.mark.interpreted
async def test_a_request_that_waits_and_meets_a_defect_fails_too(monkeypatch):
    events, device, client = [], RaisingDevice(answers_first=True), Asker()
    driver = mirror_of(device, events.append)
    driver.start()
    await asyncio.sleep(0.1)
    driver.submit(client.ask("03 00 00 00 01", unit=241), asyncio.get_running_loop().time())
    with monkeypatch.context() as patched:
        patched.setattr(driver.unit, "_read", lambda *_: 1 // 0)
        device.polls.pop().respond(bytes.fromhex("03 14") + bytes(20))
    assert client.answers == ["83 04"]
    assert [type(event) for event in events] == [PartFailed]
    assert driver.unit._clients == {}
    driver.close()


@pytest.mark.interpreted
async def test_what_comes_behind_a_request_that_meets_a_defect_is_answered_once_and_never_carried_out(monkeypatch):
    events, device, client = [], BrokenDevice(), Asker()
    device.is_broken = False
    driver = mirror_of(device, events.append)
    driver.start()
    await asyncio.sleep(0.1)
    (poll,) = device.asked
    driver.submit(client.ask("03 00 00 00 01", unit=241), asyncio.get_running_loop().time())
    with monkeypatch.context() as patched:
        patched.setattr(driver.unit, "_read", lambda *_: 1 // 0)
        driver.submit(client.ask("06 00 01 00 05", unit=241), asyncio.get_running_loop().time())
    poll.respond(bytes.fromhex("03 14") + bytes(20))
    assert client.answers == ["83 04", "86 04"]
    assert device.asked == [poll]
    assert [type(event) for event in events] == [PartFailed]
    driver.close()
