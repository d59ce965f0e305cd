"""Records on a real disk: what damage, missing files, torn writes and failing disks leave of them."""

import errno
import os
from collections.abc import Iterator
from contextlib import closing, nullcontext
from itertools import combinations
from pathlib import Path

import pytest

from gateway.errors import StateError
from gateway.state import files, page_log, pages
from gateway.state.page_log import Content, PageLog
from gateway.state.pages import LONGEST, PAGE

#: Pages of the log in most of these tests.
FEW = 8


@pytest.fixture
def name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(page_log, "PAGES", FEW)
    monkeypatch.setattr(page_log, "SIZE", FEW * PAGE)
    return tmp_path / "state" / "kept"


class Kept:
    """Numbered values, as they are and as a log has them."""

    def __init__(self, name: Path) -> None:
        self.values: dict[int, int] = {}
        self.log = PageLog(name)
        self.damage = self._read(self.log.open())

    def _read(self, content: Content) -> str:
        for record in content.records:
            for pair in record.split(b" "):
                key, _, value = pair.partition(b"=")
                self.values[int(key)] = int(value)
        return content.damage

    def begin(self) -> None:
        self.log.write((), lambda: _records(self.values))

    def write(self, **changed: int) -> None:
        values = {int(key.removeprefix("at")): value for key, value in changed.items()}
        self.log.write(_records(values), lambda: _records(self.values | values))
        self.values |= values

    def close(self) -> None:
        self.log.close()


def _records(values: dict[int, int]) -> Iterator[bytes]:
    return (b"%d=%d" % each for each in values.items())


def read(name: Path) -> tuple[dict[int, int], str]:
    with closing(Kept(name)) as kept:
        return kept.values, kept.damage


def killed(name: Path, commits: int) -> dict[int, int]:
    """Leave what a killed process leaves after so many commits; the values that were written."""
    with closing(Kept(name)) as kept:
        kept.begin()
        for number in range(commits):
            kept.write(**{f"at{number % 3}": number})
        return kept.values


def files_of(name: Path) -> list[Path]:
    return [Path(f"{name}.snapshot"), Path(f"{name}.log")]


@pytest.mark.parametrize("commits", [0, 1, FEW, FEW + 1, FEW + 2, 5 * FEW + 3])
def test_what_was_written_is_read(name: Path, commits: int) -> None:
    assert read(name) == ({}, "")
    assert killed(name, commits) == {number % 3: number for number in range(commits)}
    assert read(name) == ({number % 3: number for number in range(commits)}, "")
    assert killed(name, 0) == {number % 3: number for number in range(commits)}
    assert read(name) == ({number % 3: number for number in range(commits)}, "")


def test_more_than_the_log_can_hold_is_written(name: Path) -> None:
    with closing(Kept(name)) as kept:
        kept.begin()
        kept.write(at1=1)
        kept.write(**{f"at{number}": number for number in range(3 * FEW * LONGEST // 8)})
        kept.write(at1=2)
        written = kept.values
    assert read(name) == (written, "")


def test_a_commit_costs_the_disk_one_block(name: Path) -> None:
    killed(name, FEW - 1)
    before = [file.read_bytes() for file in files_of(name)]
    with closing(Kept(name)) as kept:
        kept.begin()
        began = [file.read_bytes() for file in files_of(name)]
        kept.write(at1=1)
    after = [file.read_bytes() for file in files_of(name)]
    assert [len(each) for each in before] == [len(each) for each in after] == [PAGE, FEW * PAGE]
    assert (before[1], began[0]) == (began[1], after[0])
    assert began[1][PAGE:] == after[1][PAGE:]


# --- damage ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("commits", "step"), [(0, 31), (3, 13), (FEW, 31), pytest.param(3, 3, marks=pytest.mark.search)]
)
def test_any_byte_that_has_changed_is_told_and_nothing_is_lost(name: Path, commits: int, step: int) -> None:
    written = killed(name, FEW + commits)
    for file in files_of(name):
        with file.open("r+b", buffering=0) as stream:
            good = file.read_bytes()
            for at in range(0, len(good), step):
                os.pwrite(stream.fileno(), bytes((good[at] ^ 1 << at % 8,)), at)
                values, damage = read(name)
                assert values == written
                assert damage.startswith("pages with one damaged copy, of which the other one was used: 1; ")
                os.pwrite(stream.fileno(), good[at : at + 1], at)


@pytest.mark.parametrize("content", [b"\0", b"\xff", b"not a log\n"])
def test_any_page_that_is_lost_is_told(name: Path, content: bytes) -> None:
    written = killed(name, FEW + 5)
    for file in files_of(name):
        good = file.read_bytes()
        for start in range(0, len(good), PAGE):
            file.write_bytes(good[:start] + (content * PAGE)[:PAGE] + good[start + PAGE :])
            values, damage = read(name)
            assert damage.startswith("pages that are damaged, and whose content is lost: 1; ")
            assert values.items() <= {*written.items(), *((number % 3, number) for number in range(FEW + 5))}
        file.write_bytes(good)


def test_a_page_that_was_never_written_is_told_unless_it_is_the_last(name: Path) -> None:
    """The disk has said that it had written it."""
    killed(name, 2 * FEW)
    log = files_of(name)[1]
    stale = log.read_bytes()
    written = killed(name, FEW)
    good = log.read_bytes()
    for page in range(FEW):
        log.write_bytes(good[: page * PAGE] + stale[page * PAGE : (page + 1) * PAGE] + good[(page + 1) * PAGE :])
        values, damage = read(name)
        if page < FEW - 1:
            assert damage.startswith("writes that are missing: 1; ")
        else:
            assert (values, damage) == (written | {(FEW - 1) % 3: FEW - 4}, "")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_a_file_that_was_cut_is_told(name: Path, share: float) -> None:
    killed(name, 5)
    for file in files_of(name):
        good = file.read_bytes()
        file.write_bytes(good[: int(share * len(good))])
        assert read(name)[1]
        file.write_bytes(good)
    assert read(name)[1] == ""


def test_a_file_that_is_missing_is_told(name: Path) -> None:
    killed(name, 5)
    for file in files_of(name):
        good = file.read_bytes()
        file.unlink()
        assert f"{file} is missing" in read(name)[1]
        file.write_bytes(good)


def test_a_snapshot_that_somebody_has_put_back_is_told(name: Path) -> None:
    killed(name, 5)
    earlier = files_of(name)[0].read_bytes()
    killed(name, 5)
    files_of(name)[0].write_bytes(earlier)
    assert read(name)[1]


def test_damage_is_told_once_and_kept_aside(name: Path) -> None:
    written = killed(name, 5)
    spoilt = {}
    for file in files_of(name):
        content = bytearray(file.read_bytes())
        content[100] ^= 1
        file.write_bytes(content)
        spoilt[file.name] = bytes(content)
    with closing(Kept(name)) as kept:
        ending = kept.damage.rpartition(" ")[2]
        kept.begin()
    assert read(name) == (written, "")
    assert {file.name: file.with_name(file.name + ending).read_bytes() for file in files_of(name)} == spoilt


def test_what_a_later_version_has_written_is_left_alone(name: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as later:
        later.setattr(pages, "_FORMAT", b"MBP2")
        killed(name, 5)
    before = [file.read_bytes() for file in files_of(name)]
    for _ in range(2):
        with pytest.raises(StateError, match="written by a later version"):
            PageLog(name).open()
    assert [file.read_bytes() for file in files_of(name)] == before


# --- power cuts and failing disks ------------------------------------------------------------------


def test_a_commit_of_which_a_part_is_on_the_disk_counts_not_at_all(name: Path) -> None:
    written = killed(name, 1)
    with closing(Kept(name)) as kept:
        kept.begin()
        log = files_of(name)[1]
        before = log.read_bytes()
        kept.write(**{f"at{number}": 7 for number in range(3 * LONGEST // 8)})
        after, whole = log.read_bytes(), kept.values
    changed = [page for page in range(FEW) if before[page * PAGE : (page + 1) * PAGE] != after[page * PAGE :][:PAGE]]
    assert len(changed) > 2
    for count in range(len(changed) + 1):
        for reached in combinations(changed, count):
            torn = [(after if page in reached else before)[page * PAGE :][:PAGE] for page in range(FEW)]
            log.write_bytes(b"".join(torn))
            assert read(name) == (whole if count == len(changed) else written, "")


@pytest.mark.parametrize("is_damaged", [False, True])
@pytest.mark.parametrize("steps", range(6))
def test_power_may_fail_at_any_step_of_a_new_beginning(
    name: Path, monkeypatch: pytest.MonkeyPatch, steps: int, is_damaged: bool
) -> None:
    replace = files.replace
    for commits in (0, 3) if not is_damaged else (3,):
        written = killed(name, commits) if commits else {}
        if is_damaged:
            content = bytearray(files_of(name)[1].read_bytes())
            content[PAGE + 100] ^= 1
            files_of(name)[1].write_bytes(content)
        left = iter(range(steps))

        def fail(file: Path, content: bytes, left: Iterator[int] = left) -> None:
            if next(left, None) is None:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            replace(file, content)

        with closing(Kept(name)) as kept, monkeypatch.context() as failing:
            failing.setattr(files, "replace", fail)
            try:
                kept.begin()
            except OSError:
                assert steps < 4
        values, damage = read(name)
        assert values == written
        assert is_damaged or not damage


def test_what_could_not_be_written_does_not_come_back(name: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with closing(Kept(name)) as kept:
        kept.begin()
        kept.write(at1=1)
        with monkeypatch.context() as failing:
            failing.setattr(os, "fdatasync", fail)
            with pytest.raises(OSError, match="Input/output error"):
                kept.write(at1=2, at2=2)
        kept.write(at3=3)
    assert read(name) == ({1: 1, 3: 3}, "")


# --- others ----------------------------------------------------------------------------------------


def test_nobody_else_can_open_it(name: Path) -> None:
    with closing(Kept(name)), pytest.raises(StateError, match="is in use; is another modbus-gateway running"):
        PageLog(name).open()
    assert read(name) == ({}, "")


@pytest.mark.parametrize("ending", ["log", "snapshot", "lock", "log.new", "snapshot.new"])
@pytest.mark.parametrize("has_target", [False, True])
def test_no_link_is_followed(name: Path, tmp_path: Path, ending: str, has_target: bool) -> None:
    precious, link = tmp_path / "precious", Path(f"{name}.{ending}")
    if has_target:
        precious.write_text("not to be touched")
    name.parent.mkdir()
    link.symlink_to(precious)
    is_replaced = ending.endswith(".new")
    expected = (
        nullcontext() if is_replaced else pytest.raises(OSError, match="is a symbolic link, which is not followed")
    )
    with expected, closing(Kept(name)) as kept:
        kept.begin()
        kept.write(at1=1)
    assert precious.exists() == has_target
    assert not has_target or precious.read_text() == "not to be touched"


@pytest.mark.parametrize("ending", ["snapshot", "log"])
def test_a_file_that_is_too_long_is_not_read_into_memory(name: Path, ending: str) -> None:
    with closing(Kept(name)) as kept:
        kept.begin()
    os.truncate(f"{name}.{ending}", 1 << 40)  # with a hole, so it takes no room
    with pytest.raises(
        OSError, match=f"has more than {page_log.LONGEST} bytes, more than the gateway writes: move it away"
    ):
        PageLog(name).open()


def test_nothing_is_written_that_could_not_be_read_again(name: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_log, "LONGEST", FEW * PAGE)
    with closing(Kept(name)) as kept:
        kept.begin()
        kept.write(at1=1)
        with pytest.raises(OSError, match="snapshot would have more than"):
            kept.write(**{f"at{place}": place for place in range(10_000)})
    assert read(name) == ({1: 1}, "")
