"""What a site tells of what it is and has, and what is made of it."""

import json
from dataclasses import replace

import pytest

from gateway.fleet.bucket import LARGEST_VALUE
from gateway.fleet.inventory import (
    LONGEST_TEXT,
    MOST_ADAPTERS,
    OwnInventory,
    SiteAdapter,
    SiteCertificate,
    SiteFinding,
    inventory_in,
)
from gateway.fleet.messages import Entry
from gateway.fleet.presence import status_of

#: 2026-05-01, 12:00 UTC.
STORED = 1_777_636_800.0
OWN = OwnInventory(
    config="634c3833bedd",
    applied_at=400.0,
    adapters=(SiteAdapter("hall", "/dev/serial/by-id/usb-FTDI-if00", "ftdi_sio", "0403:6001"),),
    certificates=(SiteCertificate("scada", "certificate", "2027-05-01"),),
    to_fix=1,
    notes=2,
    worst=(SiteFinding("unit silo", "does not answer"),),
    examined_at=990.0,
)


def told(**changed):
    return OWN.told(now=1000.0) | changed


def test_what_is_told_is_understood_and_its_times_are_those_of_the_server():
    known = inventory_in(json.loads(json.dumps(told())), STORED)
    assert (known.config, known.to_fix, known.notes) == ("634c3833bedd", 1, 2)
    assert (known.adapters, known.certificates, known.worst) == (OWN.adapters, OWN.certificates, OWN.worst)
    assert (known.applied, known.examined) == ("2026-05-01T11:50:00Z", "2026-05-01T11:59:50Z")


def test_the_entry_of_the_largest_site_fits_into_the_bucket():
    long = "\u4e2d" * 300
    largest = replace(
        OWN,
        adapters=(SiteAdapter("l" * 64, long, "d" * 64, "0403:6001"),) * 500,
        certificates=(SiteCertificate("l" * 64, "certificate", "2027-05-01"),) * 500,
        worst=(SiteFinding("u" * 64, long),) * 500,
    )
    entry = json.dumps({"lines_down": ["l" * 64] * 100, "inventory": largest.told(1000.0)}).encode()
    assert len(entry) < LARGEST_VALUE
    known = inventory_in(json.loads(entry)["inventory"], STORED)
    assert (len(known.adapters), len(known.certificates), len(known.worst)) == (MOST_ADAPTERS, 8, 3)
    assert len(known.adapters[0].port) == LONGEST_TEXT


@pytest.mark.parametrize(
    "broken",
    [
        {"config_s": "soon"},
        {"config_s": float("inf")},
        {"examined_s": -1e300},
        {"to_fix": "9" * 5000},
        {"to_fix": None},
        {"to_fix": 10**400},  # more than a metric can be
        {"notes": -1},
        {"config_s": 1e17},  # a year that the system cannot write: not a ValueError
        {"adapters": [["hall", "/dev/ttyS0"]]},
        {"adapters": 7},
        {"certificates": [["scada", "certificate", "tomorrow"]]},
        {"worst": [5]},
    ],
)
def test_a_site_with_an_inventory_that_is_not_understood_is_shown_without(broken):
    assert inventory_in(told(**broken), STORED) is None
    state = {"host": "box", "version": "9", "up_s": 5.0, "lines": 2, "lines_down": [], "units": 7, "state": "up"}
    entry = json.dumps(state | {"inventory": told(**broken)}).encode()
    shown = status_of(Entry("a", entry, 1, STORED), STORED)
    assert (shown.site, shown.state, shown.inventory) == ("a", "up", None)


@pytest.mark.parametrize("nothing", [None, 5, "text", []])
def test_an_old_version_tells_no_inventory(nothing):
    assert inventory_in(nothing, STORED) is None


def test_what_it_says_can_be_shown_in_a_terminal():
    shown = inventory_in(told(config="a\x1b[2J" + "b" * 99, worst=[["\x07unit", "\u202edoes not"]]), STORED)
    assert (shown.config, shown.worst[0]) == ("a[2Jbbbbbbb", SiteFinding("unit", "does not"))
