"""The register map of the gateway's own unit, and its page in the docs."""

from itertools import pairwise
from pathlib import Path

import pytest

from gateway.images.self_map import FAILING_UNITS, GATEWAY, PLACE_SIZE, PLACES, RANGES, SECTIONS, document, points

PAGE = Path(__file__).parents[2] / "docs" / "own-registers.md"
TABLES = [("gateway", GATEWAY, FAILING_UNITS), *((one.title, one.registers, PLACE_SIZE) for one in SECTIONS)]


def test_the_page_is_current():
    assert PAGE.read_text(encoding="utf-8") == document(), "not current: uvx nox -s gen"


@pytest.mark.parametrize(("registers", "room"), [pytest.param(*rest, id=title) for title, *rest in TABLES])
def test_no_two_values_share_a_register(registers, room):
    assert all(one.at + one.count <= other.at for one, other in pairwise(registers))
    assert registers[-1].at + registers[-1].count <= room


def test_the_page_names_every_register_at_its_place():
    page = document()
    for _, registers, _ in TABLES:
        for one in registers:
            span = f"{one.at}-{one.at + one.count - 1}" if one.count > 1 else str(one.at)
            assert f"| {span} | `{one.name}` | {one.type} | {one.unit} | {one.what} |\n" in page


def test_places_of_different_parts_do_not_meet():
    assert all(one[1] < other[0] for one, other in pairwise(RANGES))
    assert all(one.states + PLACES <= other.states for one, other in pairwise(SECTIONS))
    assert {last - first + 1 for first, last in RANGES[1:]} == {PLACES * PLACE_SIZE}


def test_a_part_keeps_its_points_when_others_follow():
    before, after = points({"Lines": ["hall-a"]}), points({"Lines": ["hall-a", "hall-b"]})
    assert [one for one in before if one not in after] == []
    assert next(one for one in after if one.name == "hall-b.state").address == 1050
