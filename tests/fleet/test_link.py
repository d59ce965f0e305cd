"""Keeping a connection to NATS, in virtual time."""

import asyncio

import pytest

from gateway.errors import FleetError
from gateway.events import FleetLost, FleetRefused, FleetUp, PartFailed
from gateway.fleet import link as module
from gateway.fleet.link import LONGEST_PAUSE, Link
from kit.fake_nats import FakeConnection, FakeNats


class Login:
    site = "a"


class Member:
    def __init__(self, error: Exception | None = None) -> None:
        self.told: list[str] = []
        self.error = error

    async def connected(self, connection):
        self.told.append("connected")
        if self.error is not None:
            raise self.error

    def disconnected(self):
        self.told.append("disconnected")


@pytest.fixture
def nats(monkeypatch) -> FakeNats:
    made = FakeNats()
    monkeypatch.setattr(FakeConnection, "nats", made, raising=False)
    monkeypatch.setattr(module, "Connection", FakeConnection)
    return made


@pytest.fixture
async def linked(nats):
    events = []
    link = Link(["nats://one", "nats://two"], Login, events.append)
    task = asyncio.create_task(link.run())
    yield link, events
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_members_are_told_of_each_connection_and_each_loss(linked, nats):
    link, events = linked
    member = Member()
    link.join(member)
    await asyncio.sleep(1)
    nats.cut()
    await asyncio.sleep(60)
    nats.down = False
    await asyncio.sleep(2 * LONGEST_PAUSE)
    assert member.told == ["connected", "disconnected", "connected"]
    assert [type(each) for each in events].count(FleetUp) == 2
    assert [each.reason for each in events if isinstance(each, FleetLost)] == [
        "the connection was lost",
        "connection refused",
    ]


async def test_members_that_are_told_of_the_loss_can_say_why(linked, nats):
    link, _ = linked
    reasons = []

    class Asker(Member):
        def disconnected(self):
            reasons.append(link.reason)

    link.join(Asker())
    await asyncio.sleep(1)
    nats.cut()
    await asyncio.sleep(1)
    assert reasons == ["the connection was lost"]


async def test_who_joins_later_is_told_at_once_and_who_leaves_is_told(linked):
    link, _ = linked
    await asyncio.sleep(1)
    member = Member()
    link.join(member)
    await asyncio.sleep(0.1)
    link.leave(member)
    assert member.told == ["connected", "disconnected"]
    await asyncio.sleep(100)
    assert member.told == ["connected", "disconnected"]


async def test_all_servers_are_tried(linked, nats):
    link, _ = linked
    await asyncio.sleep(1)
    nats.cut()
    tried = set()
    for _ in range(100):
        await asyncio.sleep(0.1)
        tried.add(link.server)
    assert tried == {"nats://one", "nats://two"}


async def test_it_is_tried_less_often_when_it_is_away_for_long(linked, nats):
    link, _ = linked
    await asyncio.sleep(1)
    nats.cut()
    await asyncio.sleep(600)
    assert 600 / (1.3 * LONGEST_PAUSE) - 2 <= link.attempts <= 600 / (0.7 * LONGEST_PAUSE) + 10


@pytest.mark.parametrize("error", [FleetError("no right"), ZeroDivisionError()])
async def test_a_member_that_cannot_use_the_connection_closes_it(linked, error):
    link, events = linked
    link.join(Member(error))
    await asyncio.sleep(30)
    assert link.connection is None
    assert any(isinstance(each, PartFailed) for each in events) == isinstance(error, ZeroDivisionError)
    assert len([each for each in events if isinstance(each, FleetUp)]) <= 1


async def test_a_refusal_is_told_once_for_each_connection(linked):
    link, events = linked
    await asyncio.sleep(1)
    for _ in range(5):
        link._refused("it has no right to publish a")
        link._refused("it has no right to publish b")
    assert len([each for each in events if isinstance(each, FleetRefused)]) == 2
