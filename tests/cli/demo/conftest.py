"""The plan of the demo for those who stay, and the day that it makes up."""

from datetime import UTC, datetime

import pytest

from gateway.cli.demo.live import LIVE_LINES
from gateway.cli.demo.past import made_up_day
from gateway.cli.demo.script import LINES
from gateway.cli.verbs import demo


@pytest.fixture(scope="session")
def now():
    return datetime(2026, 11, 28, 23, 4, 5, tzinfo=UTC).timestamp()


@pytest.fixture(scope="session")
def plan(tmp_path_factory):
    lines = (*LINES, *LIVE_LINES)
    plan, _ = demo._plan(demo._write_config(tmp_path_factory.mktemp("demo"), lines, None, None))
    return plan


@pytest.fixture(scope="session")
def day(plan, now):
    return made_up_day(plan, now)
