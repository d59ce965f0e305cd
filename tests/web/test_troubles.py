"""In which order a wall panel names what is wrong: it has room for some of it only."""

from gateway.web.pages.overview import Trouble, worst_first


def test_a_panel_names_what_must_be_fixed_before_what_fails_now_and_then():
    known = [
        Trouble("full", "lines", "hall"),
        Trouble("resting", "units", "axis"),
        Trouble("failing", "units", "mixer"),
        Trouble("failing", "units", "drive", found=("answers as another unit",)),
        Trouble("fix", "lines", "yard", found=("another client sends requests on this line",)),
        Trouble("down", "lines", "dock"),
    ]
    assert [each.name for each in worst_first(known)] == ["dock", "axis", "drive", "yard", "hall", "mixer"]
