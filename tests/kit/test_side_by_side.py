"""Jobs side by side: each begins when it may, each can fail the whole, and what each prints is shown once."""

import os
import shlex
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from kit import passes
from kit.side_by_side import Job, side_by_side

_TESTS = Path(__file__).parents[1]
_RUN = """
import sys
from itertools import pairwise
from pathlib import Path
from kit.side_by_side import Job, side_by_side
side_by_side([Job("endless", ("sh", "-c", "echo begun; exec sleep 600"), waits=True, live=True)], Path(sys.argv[1]))
"""


def shell(name: str, text: str, **more) -> Job:
    return Job(name, ("sh", "-c", text), **more)


def test_all_that_pass_are_shown_once_those_that_wait_as_they_go(tmp_path: Path, capfd) -> None:
    jobs = [shell("one", "echo 1"), shell("live", "echo 2", waits=True, live=True), shell("three", "echo 3 >&2")]
    assert side_by_side(jobs, tmp_path) == []
    assert sorted(capfd.readouterr().out.split()) == ["1", "2", "3"]


@pytest.mark.parametrize("more", [{}, {"waits": True}, {"waits": True, "live": True}, {"decides": True}])
def test_one_that_fails_is_named_and_shown(tmp_path: Path, capfd, more) -> None:
    assert side_by_side([shell("bad", "echo 1; exit 3", **more)], tmp_path) == ["bad"]
    assert capfd.readouterr().out.split() == ["1"]


def test_the_others_go_on(tmp_path: Path) -> None:
    jobs = [shell("bad", "exit 1"), shell("good", f"sleep 0.5; touch '{tmp_path}/done'")]
    assert side_by_side(jobs, tmp_path) == ["bad"]
    assert (tmp_path / "done").exists()


def test_unless_it_decides(tmp_path: Path) -> None:
    jobs = [shell("endless", "exec sleep 600", waits=True, live=True), shell("bad", "exit 1", decides=True)]
    assert side_by_side(jobs, tmp_path) == ["endless", "bad"]


def test_one_begins_after_another_has_ended(tmp_path: Path) -> None:
    file = tmp_path / "made"
    jobs = [shell("after", f"cat '{file}'", after="first"), shell("first", f"sleep 0.5; touch '{file}'; exit 1")]
    assert side_by_side(jobs, tmp_path) == ["first"]


def test_each_core_has_one_that_computes(tmp_path: Path) -> None:
    """Each notes how many there are, which are done as soon as there is one."""
    count = (
        f"mkdir '{tmp_path}'/running.$$; ls -d '{tmp_path}'/running.* | wc -l; sleep 0.2; rmdir '{tmp_path}'/running.$$"
    )
    jobs = [shell(f"job {number}", count) for number in range(3 * (os.cpu_count() or 1))]
    assert side_by_side(jobs, tmp_path) == []
    seen = [int((tmp_path / f"{job.name.replace(' ', '-')}.log").read_text()) for job in jobs]
    assert max(seen) <= (os.cpu_count() or 1)


def test_who_ends_it_ends_what_runs(tmp_path: Path) -> None:
    own = os.environ | {"PYTHONPATH": str(_TESTS)}
    with subprocess.Popen(
        [sys.executable, "-c", _RUN, tmp_path], stdout=subprocess.PIPE, text=True, env=own
    ) as running:
        assert running.stdout.readline() == "begun\n"
        running.send_signal(signal.SIGTERM)
        assert running.stdout.read() == ""  # and so nobody holds it open
    assert running.returncode != 0


def words_of(jobs: list[Job]) -> list[tuple[str, str]]:
    """Each word of their commands, and the one before it."""
    return [pair for job in jobs for pair in pairwise(shlex.split(" ".join(job.command)))]


@pytest.mark.parametrize("jobs", [passes.of_tests(), passes.of_check(), passes.of_ci()], ids=["tests", "check", "CI"])
def test_what_is_tested_is_there(jobs: list[Job]) -> None:
    """pytest says nothing when what it shall ignore is not."""
    named = [word for _, word in words_of(jobs) if word.startswith("tests/")]
    assert named
    assert [path for path in named if not (_TESTS.parent / path).exists()] == []
    assert {job.after for job in jobs} - {job.name for job in jobs} <= {""}


@pytest.mark.parametrize("jobs", [passes.of_tests(), passes.of_ci()], ids=["tests", "CI"])
def test_what_one_job_ignores_another_one_runs(jobs: list[Job]) -> None:
    ignored = {word for before, word in words_of(jobs) if before == "--ignore"}
    run = {word for before, word in words_of(jobs) if before != "--ignore"}
    assert "tests" in run
    assert ignored <= run
