"""`status --fleet`: readable with five hundred sites."""

from dataclasses import replace
from datetime import date

from gateway.cli.kit.paint import plain
from gateway.cli.show.fleet import sites_as_text
from gateway.operator.operations.answers.status import Sites
from kit.sites import INVENTORY, TO_FIX, site

TODAY = date(2026, 5, 1)


def shown(*sites, width=120, shows_all=False):
    return plain(sites_as_text(Sites(sites), TODAY, width, shows_all=shows_all)).splitlines()


def test_few_sites_are_all_shown_those_with_trouble_first():
    told = shown(site("a"), site("b", state="lost"), site("c", inventory=TO_FIX))
    assert [row.split()[0] for row in told[2:5]] == ["b", "c", "a"]
    assert told[4].split() == ["a", "up", "90", "s", "2", "-", "7", "-", "365", "d", "634c3833bedd", "0.1.0", "gw-a"]
    assert told[-1] == "3 sites: 2 up, 1 lost; 1 with something to fix (modbus-gateway doctor there)"


def test_of_many_only_those_are_listed_that_somebody_has_to_look_at():
    old = replace(INVENTORY, config="0ld")
    sites = [site(f"plant-{number}", inventory=old if number < 20 else INVENTORY) for number in range(1, 499)]
    sites += [site("x", lines_down=("hall",)), site("y", state="silent")]
    told = shown(*sites)
    assert [row.split()[0] for row in told[2:4]] == ["x", "y"]
    assert told[4:] == [
        "  498 sites are fine; --all lists them, too",
        "",
        "500 sites: 499 up, 1 silent; 1 with lines down",
        "2 configs: 634c3833bedd at 481, 0ld at 19",
    ]
    assert len(shown(*sites, shows_all=True)) == 2 + 500 + 3


def test_many_sites_that_are_all_fine_need_no_table():
    told = shown(*(site(f"plant-{number}") for number in range(60)))
    assert told == ["  60 sites are fine; --all lists them, too", "", "60 sites: 60 up"]
    assert shown(site("a"))[-1] == "1 site: 1 up"
    lost = [site(f"lost-{number}", state="lost") for number in range(60)]
    assert "  1 site is fine; --all lists it, too" in shown(site("a"), *lost)


def test_of_many_lines_that_are_down_the_first_are_named():
    told = shown(site("a", lines_down=tuple(f"hall-{number}" for number in range(9))))
    assert "hall-0, hall-1, hall-2 and 6 more  7" in told[2]
