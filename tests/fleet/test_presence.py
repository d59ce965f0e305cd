"""What sites say of themselves, and what is made of it."""

import asyncio
import json

import pytest

from gateway.errors import FleetError
from gateway.fleet.messages import Entry
from gateway.fleet.presence import LOST_AFTER, PERIOD, Presence, status_of
from gateway.fleet.status import SiteStatus
from kit.fake_nats import FakeBucket

TOLD = {"host": "box", "version": "1", "up_s": 5.0, "lines": 2, "lines_down": ["hall"], "units": 7}


def presence(site="a", told=TOLD):
    return Presence(site, lambda: told, lambda _: None, lambda: 123.0)


async def test_a_site_is_seen_until_it_is_lost():
    bucket, a, b = FakeBucket(), presence("a"), presence("b")
    await a.connected(bucket)
    await b.connected(bucket)
    await asyncio.sleep(3 * PERIOD)
    assert [(each.site, each.state) for each in await a.sites()] == [("a", "up"), ("b", "up")]
    b.disconnected()
    await asyncio.sleep(LOST_AFTER + PERIOD)
    here, lost = await a.sites()
    assert (here.state, lost.state, lost.for_s) == ("up", "lost", pytest.approx(LOST_AFTER + PERIOD, abs=PERIOD))
    a.disconnected()


async def test_a_site_that_says_so_has_left_and_since_when():
    bucket, a, b = FakeBucket(), presence("a"), presence("b")
    await a.connected(bucket)
    await b.connected(bucket)
    await asyncio.sleep(1)
    await b.leave()
    await asyncio.sleep(500)
    _, left = await a.sites()
    assert (left.state, left.for_s) == ("left", 500.0)
    a.disconnected()


async def test_who_may_not_tell_still_sees():
    bucket, a, b = FakeBucket(), presence("a"), presence("b")
    await b.connected(bucket)
    await asyncio.sleep(1)
    bucket.refuses = True
    await a.connected(bucket)
    await asyncio.sleep(1)
    assert [each.site for each in await a.sites()] == ["b"]
    assert a.reason == "no right"
    a.disconnected()
    b.disconnected()


async def test_nothing_is_told_before_the_gateway_serves():
    bucket, told = FakeBucket(), {}
    a = presence("a", told)
    await a.connected(bucket)
    await asyncio.sleep(5)
    assert bucket.held == {}
    told.update(TOLD)
    await asyncio.sleep(1)
    assert json.loads(bucket.held["a"].value)["state"] == "up"
    a.disconnected()


async def test_without_nats_nobody_is_seen():
    with pytest.raises(FleetError):
        await presence().sites()


def unreadable(site: str, age: float) -> SiteStatus:
    return SiteStatus(site, "cannot be read", age, "", "", "", 0, (), 0)


def told(**changed: object) -> bytes:
    return json.dumps(TOLD | {"state": "up"} | changed).encode()


@pytest.mark.parametrize(
    "value",
    [
        told().replace(b'"lines": 2', b'"lines": 1e999'),
        told(up_s=float("nan")),
        told(up_s=float("inf")),
        b"[" * 60000,
        told(lines=[]),
        told(lines="9" * 5000),
        told(lines_down=5),
        told(up_s=1e17),  # a year that the system cannot write: not a ValueError
        told(up_s=-1e17),
        told(lines=-1),
        told(units=10**400),
    ],
)
def test_a_site_whose_entry_no_site_would_write_is_named(value):
    assert status_of(Entry("a", value, 1, 5.0), 7.0) == unreadable("a", 2.0)


def test_what_an_entry_says_can_be_shown_in_a_terminal():
    value = told(host="a\x1b[2Jb\n", version="1\u202e", lines_down=["\x07hall"])
    shown = status_of(Entry("a\x9b", value, 1, 5.0), 5.0)
    assert shown is not None
    assert (shown.site, shown.host, shown.version, shown.lines_down) == ("a", "a[2Jb", "1", ("hall",))


@pytest.mark.parametrize("value", [b"", b"[]", b"{", b"1", b'{"state": "up"}', b"\xff", json.dumps(TOLD).encode()])
def test_a_site_whose_entry_says_nothing_is_named(value):
    assert status_of(Entry("a", value, 1, 5.0), 7.0) == unreadable("a", 2.0)
