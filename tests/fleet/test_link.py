"""Keeping a connection to NATS, in virtual time."""

import asyncio
from contextlib import asynccontextmanager

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
    monkeypatch.setattr(module, "NatsConnection", FakeConnection)
    return made


@asynccontextmanager
async def linked(*members: Member):
    """A link that keeps a connection for them, and the events that it tells."""
    events = []
    link = Link(["nats://one", "nats://two"], Login, events.append)
    task = asyncio.create_task(link.run(*members))
    try:
        yield link, events
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_members_are_told_of_each_connection_and_each_loss(nats):
    member = Member()
    async with linked(member) as (_, events):
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
    assert member.told[3:] == ["disconnected"]


async def test_members_that_are_told_of_the_loss_can_say_why(nats):
    reasons = []

    class Asker(Member):
        def disconnected(self):
            reasons.append(link.reason)

    async with linked(Asker()) as (link, _):
        await asyncio.sleep(1)
        nats.cut()
        await asyncio.sleep(1)
        assert reasons == ["the connection was lost"]


async def test_all_servers_are_tried(nats):
    async with linked() as (link, _):
        await asyncio.sleep(1)
        nats.cut()
        tried = set()
        for _ in range(100):
            await asyncio.sleep(0.1)
            tried.add(link.server)
        assert tried == {"nats://one", "nats://two"}


async def test_it_is_tried_less_often_when_it_is_away_for_long(nats):
    async with linked() as (link, _):
        await asyncio.sleep(1)
        nats.cut()
        await asyncio.sleep(600)
        assert 600 / (1.3 * LONGEST_PAUSE) - 2 <= link.attempts <= 600 / (0.7 * LONGEST_PAUSE) + 10


@pytest.mark.parametrize("error", [FleetError("no right"), ZeroDivisionError()])
async def test_a_member_that_cannot_use_the_connection_closes_it(nats, error):
    first, unable, last = Member(), Member(error), Member()
    async with linked(first, unable, last) as (link, events):
        await asyncio.sleep(1)
        assert link.connection is None
        assert nats.connections == []
        assert any(isinstance(each, PartFailed) for each in events) == isinstance(error, ZeroDivisionError)
        assert not any(isinstance(each, FleetUp) for each in events)
        assert first.told[:2] == unable.told[:2] == ["connected", "disconnected"]
        assert last.told == []


async def test_a_refusal_is_told_once_for_each_connection(nats):
    async with linked() as (link, events):
        await asyncio.sleep(1)
        for _ in range(5):
            link._refused("it has no right to publish a")
            link._refused("it has no right to publish b")
        assert len([each for each in events if isinstance(each, FleetRefused)]) == 2
