"""Which sites of a fleet are not fine, and what they have in common; as a file for spreadsheets."""

import csv
from dataclasses import replace
from datetime import date
from math import inf

import pytest

from gateway.fleet.inventory import SiteCertificate, SiteFinding
from gateway.operator.fleet.sites import days_left, is_fine, summary_of
from gateway.operator.fleet.sites_csv import COLUMNS, sites_as_csv
from kit.sites import INVENTORY, TO_FIX, site

TODAY = date(2026, 5, 1)
EXPIRING = replace(INVENTORY, certificates=(SiteCertificate("scada", "certificate", "2026-05-20"),))


@pytest.mark.parametrize(
    ("changed", "fine"),
    [
        ({}, True),
        ({"inventory": None}, True),
        ({"state": "silent"}, False),
        ({"state": "left"}, False),
        ({"state": "lost"}, False),
        ({"state": "cannot be read"}, False),
        ({"lines_down": ("hall",)}, False),
        ({"inventory": TO_FIX}, False),
        ({"inventory": EXPIRING}, False),
    ],
)
def test_a_site_is_fine_if_nobody_has_to_look(changed, fine):
    assert is_fine(site("a", **changed), TODAY) is fine


def test_the_days_left_are_those_of_the_first_certificate_to_expire():
    assert days_left(site("a"), TODAY) == 365
    assert days_left(site("a", inventory=None), TODAY) == inf


def test_sites_are_counted_by_what_they_have_in_common():
    old = replace(INVENTORY, config="0ld")
    sites = [
        site("a"),
        site("b", state="lost"),
        site("c", inventory=old, version="0.0.9"),
        site("d", inventory=TO_FIX, lines_down=("hall",)),
        site("e", inventory=EXPIRING),
        site("f", inventory=None),
    ]
    summary = summary_of(sites, TODAY)
    assert summary.states == [("up", 5), ("lost", 1)]
    assert (summary.sites, summary.lines_down, summary.to_fix, summary.expiring) == (6, 1, 1, 1)
    assert summary.configs == [("634c3833bedd", 4), ("0ld", 1)]
    assert summary.versions == [("0.1.0", 5), ("0.0.9", 1)]


def test_a_spreadsheet_gets_all_that_is_known_and_no_formula():
    worst = replace(TO_FIX, worst=(SiteFinding("=cmd()", "does not answer"),))
    sites = [site("a", inventory=worst, lines_down=("hall", "roof")), site("b", inventory=None)]
    one, other = csv.DictReader(sites_as_csv(sites).splitlines())
    assert tuple(one) == COLUMNS
    assert (one["site"], one["state"], one["for"], one["lines_down"]) == ("a", "up", "90.0", "hall; roof")
    assert (one["config"], one["to_fix"], one["expires"]) == ("634c3833bedd", "2", "2027-05-01")
    assert one["worst"] == "'=cmd(): does not answer"
    assert one["adapters"] == "hall /dev/serial/by-id/usb-FTDI-if00 ftdi_sio 0403:6001"
    assert one["certificates"] == "scada certificate 2027-05-01; scada ca 2036-05-01"
    assert (other["site"], other["config"], other["adapters"]) == ("b", "", "")
