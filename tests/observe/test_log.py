"""How events look in the log, and that a log never does harm."""

import io
import json
import logging

import pytest

from gateway.events import ClientConnected, LineLost, Ready
from gateway.observe.log import open_log

LOST = LineLost("hall-a", "/dev/ttyUSB0", "unplugged")


@pytest.fixture(autouse=True)
def _python_logging_as_it_was():
    before = logging.getLogger().handlers
    yield
    logging.getLogger().handlers = before


def test_json_is_one_object_a_line_with_the_fields_of_the_event() -> None:
    stream = io.StringIO()
    open_log("info", "json", stream)(LOST)
    logged = json.loads(stream.getvalue())
    assert logged.pop("timestamp").endswith("Z")
    assert logged == {
        "event": "line_lost", "level": "warning", "line": "hall-a", "port": "/dev/ttyUSB0", "reason": "unplugged",
    }  # fmt: skip


def test_console_is_plain_text_when_it_is_no_terminal() -> None:
    stream = io.StringIO()
    open_log("info", "auto", stream)(Ready(("tcp://127.0.0.1:502", "tcp://[::1]:502"), 2, 1))
    (line,) = stream.getvalue().splitlines()
    assert "ready" in line
    assert "listeners='tcp://127.0.0.1:502, tcp://[::1]:502'" in line
    assert "\x1b" not in line


@pytest.mark.parametrize(("no_color", "colored"), [(None, True), ("1", False)])
def test_a_terminal_gets_colours_unless_no_color_is_set(
    monkeypatch: pytest.MonkeyPatch, no_color: str | None, colored: bool
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_color:
        monkeypatch.setenv("NO_COLOR", no_color)
    stream = io.StringIO()
    stream.isatty = lambda: True  # type: ignore[method-assign]
    open_log("info", "console", stream)(LOST)
    assert ("\x1b" in stream.getvalue()) is colored


def test_events_below_the_level_are_not_written() -> None:
    stream = io.StringIO()
    open_log("info", "json", stream)(ClientConnected("scada", "10.0.0.9:1"))
    open_log("error", "json", stream)(LOST)
    assert stream.getvalue() == ""


def test_what_libraries_log_is_written_the_same_way() -> None:
    stream = io.StringIO()
    open_log("info", "json", stream)
    logging.getLogger("asyncio").warning("slow %s", "callback")
    logging.getLogger("asyncio").info("not worth a line")
    logged = json.loads(stream.getvalue())
    assert (logged["event"], logged["level"], logged["message"]) == ("asyncio", "warning", "slow callback")


def test_a_log_that_cannot_be_written_is_given_up() -> None:
    stream = io.StringIO()
    emit = open_log("info", "json", stream)
    stream.close()
    emit(LOST)
