"""A mirror on the clock: a defect in it stays in it."""

import asyncio

import pytest

from gateway.events import PartFailed
from gateway.images.mirror_driver import MirrorDriver
from gateway.images.polls import MirrorSettings, Poll
from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile
from kit.asker import Asker


class BrokenDevice:
    """A device whose check has a defect until it is mended; then it takes requests and never answers."""

    is_broken = True

    def __init__(self):
        self.asked = []

    def submit(self, request, now, *, yields=False):
        if self.is_broken:
            raise ZeroDivisionError
        self.asked.append(request)

    def is_resting(self, now):
        return False


@pytest.mark.interpreted
@pytest.mark.parametrize("pdu", ["06 00 01 00 05", "03 00 00 00 01"])
async def test_a_request_that_meets_a_defect_fails_and_the_next_one_goes_on(monkeypatch, pdu):
    events, device, client = [], BrokenDevice(), Asker()
    polls = (Poll(Area.HOLDING, 0, 9, 0.5),)
    settings = MirrorSettings(241, "silo", "silo-1", Profile("a"), polls, {Area.HOLDING: ((0, 9),)}, 2.0, "g.toml:1")
    driver = MirrorDriver(settings, device, asyncio.get_running_loop(), events.append)
    with monkeypatch.context() as patched:
        patched.setattr(driver.mirror, "_read", lambda *_: 1 // 0)
        driver.submit(client.ask(pdu, unit=241), 0.0)
    function = int(pdu[:2]) | 0x80
    assert client.answers == [f"{function:02X} 04"]
    assert [type(event) for event in events] == [PartFailed]
    device.is_broken = False
    driver.submit(client.ask("06 00 01 00 05", unit=241), 0.0)
    assert len(device.asked) == 1
    device.asked[0].respond(bytes.fromhex("06 00 01 00 05"))
    assert client.answers[1:] == ["06 00 01 00 05"]
    assert driver.mirror._rows == {}
    driver.close()
