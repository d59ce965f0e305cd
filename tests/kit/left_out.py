"""A plugin for pytest: tests that cannot run here, and what would let them run.

`@pytest.mark.needs("mbpoll", ...)` leaves a test out where a program is missing. With `--left-out FILE` each test that
is left out is noted in FILE; as a command, `left_out.py FILE`, this prints them. Where CI is set, such a test fails.
"""

import json
import os
import sys
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Final

import pytest

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.programs import PACKAGES, find

#: Why a test may be left out by CI too.
NOT_IN_CI: Final = ("there is no udevadm that verifies rules",)  # Debian 12 has none


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    parser.addoption("--left-out", metavar="FILE", help="note here which tests are left out, and why")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave a test out whose programs are missing."""
    for mark in item.iter_markers("needs"):
        need(*mark.args)


def need(*programs: str) -> None:
    """Leave the test that calls this out if one of `programs` is missing."""
    for program in programs:
        if find(program) is None:
            pytest.skip(f"{program} is not installed (apt install {PACKAGES[program]})")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note that a test is left out; in CI it fails."""
    report = yield
    if report.skipped and isinstance(report.longrepr, tuple):  # that of an xfail is none
        why = report.longrepr[2].removeprefix("Skipped: ")
        if (file := item.config.getoption("--left-out")) is not None:
            with Path(file).open("a", encoding="utf-8") as notes:
                print(json.dumps([item.nodeid, why]), file=notes)
        if os.environ.get("CI") and not any(each in why for each in NOT_IN_CI):
            report.outcome, report.longrepr = "failed", f"{why}: CI leaves no test out"
    return report


def told(notes: str) -> list[str]:
    """Return what was left out, in lines: how many tests for which reason, and what to install."""
    reasons = dict(json.loads(line) for line in notes.splitlines())  # a test may have been left out in several passes
    counts = Counter(reasons.values()).most_common()
    lines = [f"{count:5} test{'' if count == 1 else 's'}: {why}" for why, count in counts]
    packages = sorted({PACKAGES[name] for name in PACKAGES if any(f"{name} is not inst" in why for why, _ in counts)})
    if packages:
        lines.append(f"to run them: apt install {' '.join(packages)}")
    return lines


if __name__ == "__main__":
    noted = Path(sys.argv[1])
    if noted.exists() and noted.stat().st_size:
        print("left out here, of all tests:", *told(noted.read_text(encoding="utf-8")), sep="\n")
