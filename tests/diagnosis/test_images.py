"""What to do about mirrors and virtual units whose sources do not answer."""

import pytest

from gateway.diagnosis.evidence import PolledEvidence, SourceEvidence
from gateway.diagnosis.finding import Finding
from gateway.diagnosis.images import LONG, about_polled

FRESH = SourceEvidence("meter-1", "hall", since=1.0)


def found(*sources: SourceEvidence, stale: float = 2.0) -> list[Finding]:
    return list(about_polled(PolledEvidence("block", "virtual unit block", stale, sources)))


def test_a_source_without_a_fresh_value_for_long_is_named_with_what_to_do() -> None:
    lost = SourceEvidence("meter-7", "yard", since=300.0)
    assert found(FRESH, lost) == [
        Finding(
            "note",
            "virtual unit block",
            "no fresh values of 1 of 2 sources: meter-7 (for 5 min)",
            "modbus-gateway trace --why meter-7 tells what became of its polls; see the rows about yard",
            "block",
        )
    ]


@pytest.mark.parametrize(
    ("source", "is_told"),
    [
        (SourceEvidence("a", since=LONG), False),
        (SourceEvidence("a", since=LONG + 1), True),
        (SourceEvidence("a", since=None), False),
        (SourceEvidence("a", since=None, is_lost=True), True),
        (SourceEvidence("a", since=3.0, is_lost=True), True),
    ],
)
def test_a_moment_without_an_answer_is_not_told(source, is_told) -> None:
    assert [each.level for each in found(FRESH, source)] == ["note" if is_told else "ok"]


def test_values_that_may_be_older_are_told_only_once_they_are_stale() -> None:
    assert [each.level for each in found(SourceEvidence("a", since=250.0), stale=300.0)] == ["ok"]
    assert [each.level for each in found(SourceEvidence("a", since=301.0), stale=300.0)] == ["note"]


def test_one_that_was_never_read_says_so() -> None:
    (told,) = found(SourceEvidence("silo", since=None, is_lost=True))
    assert told.what == "no fresh values of its source: silo (never read)"
    assert told.remedy == "modbus-gateway trace --why silo tells what became of its polls"


def test_of_many_some_are_named() -> None:
    (told,) = found(*(SourceEvidence(f"m{each}", since=120.0) for each in range(20)))
    assert told.what.endswith("m7 (for 2 min) and 12 more")
    assert told.what.startswith("no fresh values of 20 of 20 sources: m0 (for 2 min), ")


def test_a_device_whose_values_do_not_fit_is_told_apart() -> None:
    invalid = SourceEvidence("meter-7", "yard", since=1.0, invalid=2)
    (told,) = found(FRESH, invalid)
    assert told.what == "values of 1 of 2 sources are not valid, or do not fit their rows: meter-7"
    assert told.remedy == "modbus-gateway read meter-7"


def test_a_device_that_refuses_what_is_mapped_is_told_apart() -> None:
    silent, refusing = SourceEvidence("meter-7", since=100.0), SourceEvidence("meter-8", is_lost=True, refused=1)
    first, second = found(FRESH, silent, refusing)
    assert first.what == "no fresh values of 1 of 3 sources: meter-7 (for 100 s)"
    assert second.what == "values of 1 of 3 sources are refused with an exception: meter-8 (never read)"
    assert second.remedy == "correct the rows of meter-8 in the config: poll_refused in the log names the addresses"


def test_fresh_sources_are_fine() -> None:
    assert [(each.level, each.what) for each in found(FRESH)] == [("ok", "its source has answered")]
    assert [(each.level, each.what) for each in found(FRESH, FRESH)] == [("ok", "all of its 2 sources have answered")]
