"""The reconnector: opens, tells, opens again, and leaves nothing behind. Seconds are virtual."""

import asyncio
import errno
from contextlib import asynccontextmanager
from itertools import pairwise

import pytest

from gateway.errors import PortError
from gateway.events import LineLost, LineReopened, LineUp
from gateway.ports import reconnector as reconnector_module
from gateway.ports.opening import explain_failure, explain_loss
from gateway.ports.port import SerialSettings
from gateway.ports.reconnector import Reconnector
from gateway.timing.characters import CharacterFormat
from kit.memory import MemoryLine

SETTINGS = SerialSettings("/dev/hall-a", 19200, CharacterFormat(8, "E", 1))
GONE = explain_loss("/dev/hall-a", OSError(errno.EIO, "Input/output error"))


def not_opened(number: int) -> str:
    """What an attempt to open the port says when the system answers with this error."""
    return explain_failure(SETTINGS, OSError(number, ""))


class Owner:
    """Notes what a line would be told."""

    def __init__(self):
        self.told = []
        self.port = None
        #: What has the port opened again, if it does not need one that ended.
        self.open_again = None
        self.needs_it = True

    def port_up(self, port):
        self.port = port
        self.told.append("up")

    def received(self, data):
        self.told.append(data)

    def port_ended(self, open_again, *, at_once):
        self.port = None
        if not self.needs_it:
            self.told.append("ended at once" if at_once else "ended")
            self.open_again = open_again
        return not self.needs_it

    def port_down(self, error):
        self.port = None
        self.told.append(f"down: {error}")


class House:
    """A reconnector with a memory line on one side and an owner on the other."""

    def __init__(self):
        self.line = MemoryLine()
        self.owner = Owner()
        self.events = []
        self.reconnector = Reconnector("hall-a", "/dev/hall-a", self.line.open_port, self.owner, self.events.append)

    @asynccontextmanager
    async def kept(self, open_port=None):
        if open_port is not None:
            self.reconnector._open_port = open_port
        task = asyncio.create_task(self.reconnector.run(), name="reconnector")
        try:
            await asyncio.sleep(0.001)
            yield
        finally:
            task.cancel()
            await asyncio.wait([task])
            assert task.cancelled()


@pytest.fixture
def house():
    return House()


async def test_it_opens_the_port_and_tells_the_owner(house):
    async with house.kept():
        assert house.reconnector.tried.is_set()
        assert house.owner.told == ["up"]
        assert house.events == [LineUp("hall-a", "/dev/hall-a")]
        house.owner.port.write(b"ask")
        assert house.line.take_written() == b"ask"


async def test_bytes_go_straight_to_the_owner(house):
    """The port calls the owner's own method: nothing stands between them."""
    async with house.kept():
        assert house.line._port.user.received == house.owner.received


async def test_a_loss_reaches_the_owner_in_the_same_turn(house):
    async with house.kept():
        house.line.pull("unplugged")
        assert house.owner.told == ["up", "down: unplugged"]


async def test_a_returned_port_is_open_again_within_two_seconds(house):
    async with house.kept():
        house.line.pull("unplugged")
        await asyncio.sleep(1000)
        house.line.plug()
        await asyncio.sleep(1.1)
        assert house.owner.told == ["up", "down: unplugged", "up"]
        assert house.reconnector.error is None


async def test_a_brief_loss_is_healed_after_a_tenth_of_a_second(house):
    async with house.kept():
        await asyncio.sleep(60)
        house.line.pull()
        house.line.plug()
        await asyncio.sleep(0.11)
        assert house.owner.told[-1] == "up"
        assert house.events[-1] == LineReopened("hall-a", "/dev/hall-a", away_s=pytest.approx(0.1))


async def test_pauses_double_up_to_a_second(house):
    attempts = []

    async def refuse(user):
        attempts.append(asyncio.get_running_loop().time())
        raise PortError("absent")

    async with house.kept(refuse):
        await asyncio.sleep(4)
    pauses = [later - earlier for earlier, later in pairwise(attempts)]
    assert pauses == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0, 1.0])


async def test_a_port_that_ends_while_nobody_needs_it_is_opened_when_somebody_does_and_nothing_is_told(house):
    async with house.kept():
        house.owner.needs_it = False
        for closes in ("the server", "the owner"):
            if closes == "the server":
                house.line.hang_up()
            else:
                house.owner.port.close()
            await asyncio.sleep(3600)
            assert not house.line.is_open
            assert house.reconnector.is_open
            house.owner.open_again()
            await asyncio.sleep(0.001)
            assert house.line.is_open
        assert house.owner.told == ["up", "ended", "up", "ended", "up"]
        assert house.events == [LineUp("hall-a", "/dev/hall-a")]
        assert house.reconnector.reopened == 0


async def test_it_is_told_whether_a_server_has_closed_at_once(house):
    async with house.kept():
        house.owner.needs_it = False
        house.line.hang_up(at_once=True)
        assert house.owner.told == ["up", "ended at once"]


async def test_a_port_that_ends_while_it_is_needed_is_lost(house):
    async with house.kept():
        house.line.hang_up()
        assert house.owner.told == ["up", "down: memory has closed the connection"]
        await asyncio.sleep(1)
        assert house.line.openings == 2
    assert [event.name for event in house.events] == ["line_up", "line_lost", "line_reopened"]


async def test_an_order_before_the_port_ended_opens_nothing(house):
    async with house.kept():
        house.owner.needs_it = False
        house.line.hang_up()
        house.owner.open_again()
        house.owner.open_again()
        await asyncio.sleep(0.001)
        house.owner.open_again()
        house.line.hang_up()
        await asyncio.sleep(60)
        assert house.line.openings == 2


async def test_a_port_that_cannot_be_opened_when_it_is_needed_is_lost(house):
    async with house.kept():
        house.owner.needs_it = False
        house.line.hang_up()
        await asyncio.sleep(60)
        house.line.pull("refused")
        house.owner.open_again()
        await asyncio.sleep(0.001)
        assert house.owner.told == ["up", "ended", "down: refused"]
        assert not house.reconnector.is_open
        await asyncio.sleep(1)
        house.line.plug()
        await asyncio.sleep(1)
        assert house.owner.told[-1] == "up"
    assert [event.name for event in house.events] == ["line_up", "line_lost", "line_reopened"]
    assert house.reconnector.reopened == 1


@pytest.mark.parametrize("when", ["while it rests", "while it is opened"])
async def test_cancelled_while_there_is_no_port_the_owner_knows(house, when):
    async with house.kept():
        house.owner.needs_it = False
        house.line.hang_up()
        if when == "while it is opened":
            house.line.opens_in = 1.0
            house.owner.open_again()
            await asyncio.sleep(0.5)
    assert house.owner.told == ["up", "ended", "down: closed"]


async def test_a_port_that_fails_as_soon_as_it_is_open_is_not_opened_ten_times_a_second(house):
    async def flap(user):
        port = await house.line.open_port(user)
        asyncio.get_running_loop().call_later(0.01, port.close)
        return port

    async with house.kept(flap):
        await asyncio.sleep(60)
    assert house.line.openings < 65


async def test_after_a_stay_the_short_pause_is_back(house):
    house.line.pull()
    async with house.kept():
        await asyncio.sleep(100)
        house.line.plug()
        await asyncio.sleep(100)
        house.line.pull()
        house.line.plug()
        await asyncio.sleep(0.11)
        assert house.line.openings == 2


async def test_a_reason_is_told_once_and_again_when_it_changes(house):
    house.line.pull("absent")
    async with house.kept():
        await asyncio.sleep(10)
        house.line.pull("no permission")
        await asyncio.sleep(10)
        house.line.plug()
        await asyncio.sleep(2)
    assert house.events == [
        LineLost("hall-a", "/dev/hall-a", "absent"),
        LineLost("hall-a", "/dev/hall-a", "no permission"),
        LineUp("hall-a", "/dev/hall-a"),
    ]


async def test_every_loss_is_told_even_for_the_same_reason(house):
    async with house.kept():
        for _ in range(2):
            house.line.pull("unplugged")
            house.line.plug()
            await asyncio.sleep(2)
    assert [event.name for event in house.events] == [
        "line_up",
        *["line_lost", "line_reopened"] * 2,
    ]


async def test_who_closes_the_port_tells_why_and_only_trouble_after_that_is_told(house):
    async with house.kept():
        house.owner.port.close()
        await asyncio.sleep(2)
        assert (house.line.openings, house.events) == (2, [LineUp("hall-a", "/dev/hall-a")])
        house.owner.port.close()
        await asyncio.sleep(0.01)
        house.line.pull("absent")
        await asyncio.sleep(2)
        house.line.plug()
        await asyncio.sleep(2)
    assert [event.name for event in house.events] == ["line_up", "line_lost", "line_reopened"]


async def test_an_unplugging_is_told_once_whatever_the_attempts_after_it_say(house):
    async with house.kept():
        house.line.pull(GONE)
        await asyncio.sleep(10)
        for number in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOENT):
            house.line.pull(not_opened(number))
            await asyncio.sleep(10)
        assert "does not exist" in str(house.reconnector.error)
    assert house.events == [LineUp("hall-a", "/dev/hall-a"), LineLost("hall-a", "/dev/hall-a", GONE)]


@pytest.mark.parametrize("number", [errno.EACCES, errno.EPERM, errno.EBUSY, errno.ENOTTY])
async def test_another_kind_of_trouble_after_a_loss_is_told_once(house, number):
    async with house.kept():
        for reason in (
            GONE,
            not_opened(errno.ENOENT),
            not_opened(number),
            not_opened(errno.ENOENT),
            not_opened(number),
        ):
            house.line.pull(reason)
            await asyncio.sleep(10)
    lost = [event.reason for event in house.events if isinstance(event, LineLost)]
    assert lost == [GONE, not_opened(number)]


async def test_a_port_that_was_absent_from_the_start_is_told_once(house):
    house.line.pull(not_opened(errno.ENOENT))
    async with house.kept():
        await asyncio.sleep(10)
    assert house.events == [LineLost("hall-a", "/dev/hall-a", not_opened(errno.ENOENT))]


async def test_a_loss_is_told_when_it_happens_not_when_the_driver_has_let_go(house):
    async with house.kept():
        house.line._port.wait_closed = asyncio.Event().wait
        house.line.pull(GONE)
        await asyncio.sleep(0.01)
        assert house.events[-1] == LineLost("hall-a", "/dev/hall-a", GONE)
        assert str(house.reconnector.error) == GONE


async def test_an_owner_that_fails_in_taking_the_port_is_told_that_it_is_gone(house):
    def port_up(port):
        raise RuntimeError("defect")

    house.owner.port_up = port_up
    with pytest.raises(RuntimeError):
        await house.reconnector.run()
    assert house.owner.told == ["down: closed"]
    assert not house.line.is_open


async def test_a_failed_first_attempt_counts_as_tried(house):
    house.line.pull("absent")
    async with house.kept():
        assert house.reconnector.tried.is_set()
        assert str(house.reconnector.error) == "absent"
        assert house.owner.told == []


async def test_a_driver_that_never_answers_is_given_up_and_tried_again(house):
    attempts = []

    async def hang(user):
        attempts.append(user)
        await asyncio.sleep(1000)

    async with house.kept(hang):
        await asyncio.sleep(reconnector_module.OPENING_DEADLINE + 0.2)
        assert "did not open it within 5 s" in str(house.reconnector.error)
        assert len(attempts) == 2
        attempts[0].lost(PortError("too late"))
    assert house.owner.told == []


async def test_a_port_lost_before_the_owner_had_it_is_a_failed_attempt(house):
    async def stillborn(user):
        port = await house.line.open_port(user)
        house.line.pull("pulled at once")
        return port

    async with house.kept(stillborn):
        assert str(house.reconnector.error) == "pulled at once"
    assert house.owner.told == []


async def test_cancelled_it_closes_the_port_and_the_owner_knows(house):
    async with house.kept():
        pass
    assert not house.line.is_open
    assert house.owner.told == ["up", "down: closed"]


async def test_a_driver_that_never_closes_holds_nobody_up(house):
    async with house.kept():
        house.line._port.wait_closed = asyncio.Event().wait
        cancelled_at = asyncio.get_running_loop().time()
    assert asyncio.get_running_loop().time() - cancelled_at == pytest.approx(reconnector_module.CLOSING_DEADLINE)
    assert house.owner.told == ["up", "down: closed"]


async def test_its_repr_is_a_status_line(house):
    house.line.pull("absent")
    assert repr(house.reconnector) == "<Reconnector hall-a /dev/hall-a not tried yet>"
    async with house.kept():
        assert repr(house.reconnector) == "<Reconnector hall-a /dev/hall-a down: absent>"
        house.line.plug()
        await asyncio.sleep(1)
        assert repr(house.reconnector) == "<Reconnector hall-a /dev/hall-a open>"
