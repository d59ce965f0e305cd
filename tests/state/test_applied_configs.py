"""The last configs that were in use survive, and nobody else can read them."""

import os
import stat

import pytest

from gateway.events import StateKeptAgain, StateNotKept
from gateway.state.applied_configs import MOST, AppliedConfigs

SECONDS = 1_777_636_800.0


class Kept:
    def __init__(self, state):
        self.events = []
        self.now = SECONDS
        self.state = state
        self.applied = AppliedConfigs(state, "gateway.toml", self.events.append, lambda: self.now)

    def keep(self, text, profiles=None, included=None):
        self.now += 60
        self.applied.keep(text, profiles or {}, included or {})

    def texts(self):
        return [self.applied.read(name).text for name in self.applied.names()]


@pytest.fixture
def kept(tmp_path):
    return Kept(tmp_path / "state")


def test_the_last_ten_are_kept_the_newest_first(kept):
    for number in range(13):
        kept.keep(f"# {number}\n")
    assert kept.texts() == [f"# {number}\n" for number in range(12, 12 - MOST, -1)]
    assert kept.events == []


def test_the_same_text_is_kept_once_in_a_row(kept):
    for text in ("a = 1", "a = 1", "a = 2", "a = 1"):
        kept.keep(text)
    assert kept.texts() == ["a = 1", "a = 2", "a = 1"]


def test_another_text_of_an_own_profile_is_another_config(kept):
    kept.keep("a = 1", {"meter": "b = 1"})
    kept.keep("a = 1", {"meter": "b = 2"})
    newest = kept.applied.read(kept.applied.names()[0])
    assert len(kept.texts()) == 2
    assert newest.profiles == {"meter": "b = 2"}
    assert (newest.file.parent / "profiles" / "meter.toml").read_text() == "b = 2"


def test_it_can_be_copied_back(kept):
    kept.keep("a = 1")
    one = kept.applied.read(kept.applied.names()[0])
    assert one.file.read_text() == "a = 1"
    assert one.file.name == "gateway.toml"
    assert one.at.timestamp() == SECONDS + 60


def test_only_its_owner_can_read_it(kept):
    before = os.umask(0)
    try:
        kept.keep("a = 1", {"meter": "b = 1"})
    finally:
        os.umask(before)
    modes = {stat.S_IMODE(each.stat().st_mode) for each in kept.applied.folder.rglob("*") if each.is_file()}
    folders = {stat.S_IMODE(each.stat().st_mode) for each in kept.applied.folder.rglob("*") if each.is_dir()}
    assert (modes, folders) == ({0o600}, {0o700})


def test_a_clock_that_is_set_back_does_not_change_the_order(kept):
    kept.keep("a = 1")
    kept.now -= 1_000_000
    kept.keep("a = 2")
    assert kept.texts() == ["a = 2", "a = 1"]


def test_what_a_power_cut_has_left_is_not_taken_for_a_config(kept):
    kept.keep("a = 1")
    left = kept.applied.folder / ".new"
    left.mkdir()
    (left / "gateway.toml").write_text("a =")
    assert kept.texts() == ["a = 1"]
    kept.keep("a = 2")
    assert kept.texts() == ["a = 2", "a = 1"]


def test_trouble_is_told_once_and_its_end_too(kept):
    kept.state.write_text("this is no folder")
    kept.keep("a = 1")
    kept.keep("a = 2")
    assert [type(each) for each in kept.events] == [StateNotKept]
    kept.state.unlink()
    kept.keep("a = 3")
    assert [type(each) for each in kept.events] == [StateNotKept, StateKeptAgain]
    assert kept.texts() == ["a = 3"]


def test_a_link_is_not_followed(kept, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    kept.state.mkdir()
    kept.applied.folder.symlink_to(tmp_path / "elsewhere")
    kept.keep("a = 1")
    assert list((tmp_path / "elsewhere").iterdir()) == []
    assert [type(each) for each in kept.events] == [StateNotKept]


def test_a_folder_with_a_planted_link_or_device_is_no_config(kept, tmp_path):
    kept.keep("a = 1")
    (tmp_path / "secret").write_text("a = 2")
    file = kept.applied.read(kept.applied.names()[0]).file
    file.unlink()
    for target in (tmp_path / "secret", "/dev/zero"):
        file.symlink_to(target)
        assert kept.applied.read(kept.applied.names()[0]) is None
        file.unlink()
    os.mkfifo(file)
    assert kept.applied.read(kept.applied.names()[0]).text == ""


@pytest.mark.parametrize("name", ["", "..", "../users", "000001-20260501T120000Z/../../users", ".new"])
def test_no_other_name_is_read(kept, name):
    kept.keep("a = 1")
    assert kept.applied.read(name) is None


def test_a_file_where_a_config_is_being_kept_gives_way(kept):
    folder = kept.state / "configs"
    folder.mkdir(parents=True)
    (folder / ".new").write_text("left by somebody")
    kept.keep("a = 1")
    assert (kept.texts(), kept.events) == (["a = 1"], [])
