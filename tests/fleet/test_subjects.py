import pytest

from gateway.fleet.headers import MOST_HOPS, hops_of, text_of
from gateway.fleet.subjects import Asked, answer_folder, asked_by, request_subject


def test_a_request_says_who_asks_for_which_unit():
    assert asked_by(request_subject("b", 41, "plant-1"), "b") == Asked(41, "plant-1")


@pytest.mark.parametrize(
    "subject",
    [
        *("mbgw.c.unit.41.from.a", "mbgw.b.unit.41.from.a.b", "mbgw.b.unit.41.from.", "mbgw.b.unit.x.from.a"),
        *("mbgw.b.unit.1000.from.a", "mbgw.b.unit.41.from.*", "mbgw.b.unit.41.from.>", "$KV.mbgw-status.a", ""),
        *("mbgw.b.unit.41.from.a\n", "xmbgw.b.unit.41.from.a"),
    ],
)
def test_another_subject_is_no_request(subject):
    assert asked_by(subject, "b") is None


def test_no_sender_has_the_answers_of_another():
    assert not answer_folder("a1", "b").startswith(answer_folder("a", "b"))


@pytest.mark.parametrize("value", ["", "-1", "x", "100", "²", " 1"])
def test_hops_that_are_no_number_are_too_many(value):
    assert hops_of(value) > MOST_HOPS
    assert hops_of("3") == 3


def test_a_header_can_be_logged():
    assert text_of("a\nb\x1b[31m" + "c" * 100) == "ab[31m" + "c" * 56
