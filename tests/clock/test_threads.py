"""Threads for drivers: named, apart from one another, and no hindrance at exit."""

import threading

import pytest

from gateway.clock.threads import ThreadPerCall
from kit.process import PATIENCE


def test_it_hands_over_the_result():
    assert ThreadPerCall("count").submit(len, b"abc").result(PATIENCE) == 3


def test_it_hands_over_the_error():
    with pytest.raises(ValueError, match="invalid literal"):
        ThreadPerCall("count").submit(int, "x").result(PATIENCE)


def test_a_call_that_hangs_holds_up_no_other_and_no_exit():
    release = threading.Event()
    threads = ThreadPerCall("open /dev/ttyS9")
    hanging = threads.submit(release.wait, PATIENCE)
    thread = threads.submit(threading.current_thread).result(PATIENCE)
    assert (thread.name, thread.daemon) == ("open /dev/ttyS9", True)
    assert not hanging.done()
    release.set()
    assert hanging.result(PATIENCE)


def test_a_call_is_not_cancelled_before_its_thread_runs():
    begin = threading.Event()
    outcome = ThreadPerCall("open").submit(begin.wait, PATIENCE)
    assert outcome.running()
    assert not outcome.cancel()
    begin.set()
    assert outcome.result(PATIENCE)
