"""Whether somebody has closed a device file is told without making the loop wait."""

import os
import pty
from threading import Event

import pytest

from gateway.hardware.closings import Closings
from kit.process import PATIENCE


def test_end_of_a_watch_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    master, program = pty.openpty()
    closings = Closings(os.ttyname(program))
    os.write(program, b"x")
    os.close(program)
    assert closings.look() == "written"
    descriptor, go_on, is_closed, close = closings.descriptor, Event(), Event(), os.close

    def close_slowly(number: int) -> None:
        go_on.wait(PATIENCE)
        close(number)
        is_closed.set()

    monkeypatch.setattr(os, "close", close_slowly)
    closings.close()
    os.fstat(descriptor)  # still open: it is closed elsewhere
    go_on.set()
    assert is_closed.wait(PATIENCE)
    monkeypatch.undo()
    os.close(master)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)
