"""A plugin for pytest: with `--skip-only WHY` a test that is skipped for another reason fails."""

from collections.abc import Generator

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--skip-only", action="append", metavar="WHY", help="fail what is skipped for another reason")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    expected = item.config.getoption("--skip-only")
    if expected is not None and report.skipped and isinstance(report.longrepr, tuple):  # that of an xfail is none
        _, _, why = report.longrepr
        if not any(each in why for each in expected):
            report.outcome, report.longrepr = "failed", f"{why}: this was not expected here"
    return report
