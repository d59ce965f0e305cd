"""What is known of other sites, how often they are asked, and the metrics of those asked from here. In virtual time."""

import asyncio
from dataclasses import replace

import pytest

from gateway.errors import FleetError
from gateway.runtime.fleet.known_sites import LOOKED, KnownSites
from gateway.runtime.fleet.metrics import metrics_of_sites
from kit.sites import INVENTORY, TO_FIX, site

SITES = (site("a"), site("b", inventory=TO_FIX, lines_down=("hall",)), site("me"))


class Reader:
    """Reads sites, and counts how often."""

    def __init__(self):
        self.times = 0
        self.error = None

    async def __call__(self, only):
        self.times += 1
        await asyncio.sleep(0.1)
        if self.error:
            raise self.error
        return [each for each in SITES if only is None or each.site in {*only, "me"}]


async def test_those_who_look_at_the_same_time_share_one_reading():
    read = Reader()
    known = KnownSites(read)
    lists = await asyncio.gather(*(known.all(10.0) for _ in range(20)))
    assert all([each.site for each in one] == ["a", "b", "me"] for one in lists)
    assert read.times == 1
    await asyncio.sleep(11)
    await known.all(10.0)
    assert read.times == 2
    await known.all(0.0)
    assert read.times == 3


async def test_a_reading_that_fails_is_told_and_tried_again():
    read = Reader()
    known = KnownSites(read)
    read.error = FleetError("no NATS")
    with pytest.raises(FleetError):
        await known.all(10.0)
    read.error = None
    assert len(await known.all(10.0)) == 3


async def test_for_metrics_only_the_sites_asked_are_read_and_once_a_minute():
    read = Reader()
    known = KnownSites(read)
    for _ in range(4):
        await known.look({"b"})
        await asyncio.sleep(LOOKED / 4)
    assert [each.site for each in known.asked] == ["b"]
    assert read.times == 1
    read.error = FleetError("no NATS")
    await known.look({"b"})
    assert (known.asked, read.times) == ((), 2)


async def test_who_asks_no_site_reads_nothing():
    read = Reader()
    known = KnownSites(read)
    await known.look(set())
    assert (list(known.asked), read.times) == ([], 0)
    assert list(metrics_of_sites(known.asked)) == []


def test_metrics_tell_what_must_be_mended_where():
    old = site("c", state="lost", inventory=None, version="0.0.9")
    unreadable = site("d", state="cannot be read", inventory=None, started="")
    families = {each.name: dict(each.values) for each in metrics_of_sites([*SITES[:2], old, unreadable])}
    assert families["fleet_sites"] == {("up",): 2, ("silent",): 0, ("left",): 0, ("lost",): 1, ("cannot be read",): 1}
    assert families["fleet_site_info"] == {
        ("a", "0.1.0", INVENTORY.config): 1,
        ("b", "0.1.0", INVENTORY.config): 1,
        ("c", "0.0.9", ""): 1,
    }
    assert families["fleet_site_lines_down"] == {("a",): 0, ("b",): 1, ("c",): 0}
    assert families["fleet_site_findings"] == {("a",): 0, ("b",): 2}
    ends = families["fleet_site_certificate_expiry_timestamp_seconds"]
    assert ends == dict.fromkeys([("a",), ("b",)], 1_809_129_600.0)
    bare = [site("a", inventory=replace(INVENTORY, certificates=()))]
    assert "fleet_site_certificate_expiry_timestamp_seconds" not in {each.name for each in metrics_of_sites(bare)}
