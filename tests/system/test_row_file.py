"""A file that is being opened when its gateway stops."""

import asyncio
import threading

from gateway.observe.event_file import events_kept
from gateway.observe.last_events import LastEvents
from gateway.state import row_file


async def test_what_was_being_opened_is_closed_again_before_the_next_one_opens_it(tmp_path, monkeypatch):
    begun, may_open, events, is_open, at_once = threading.Event(), threading.Event(), [], row_file.open_table, []

    def open_late(*where):
        begun.set()
        may_open.wait(5.0)
        at_once.append(is_open(*where))
        return at_once[0]

    monkeypatch.setattr(row_file, "open_table", open_late)
    async with events_kept(LastEvents(), tmp_path, events.append):
        assert await asyncio.to_thread(begun.wait, 5.0)
        asyncio.get_running_loop().call_later(0.05, may_open.set)
    monkeypatch.setattr(row_file, "open_table", is_open)
    assert at_once
    async with events_kept(LastEvents(), tmp_path, events.append):
        await asyncio.sleep(0.2)
    assert events == []


async def test_a_disk_that_hangs_is_not_waited_for(tmp_path, monkeypatch):
    begun, may_open = threading.Event(), threading.Event()

    def hang(*_):
        begun.set()
        may_open.wait(10.0)
        raise OSError("too late")

    monkeypatch.setattr(row_file, "open_table", hang)
    monkeypatch.setattr(row_file, "CLOSING_DEADLINE", 0.1)
    loop = asyncio.get_running_loop()
    async with events_kept(LastEvents(), tmp_path, lambda _: None):
        assert await asyncio.to_thread(begun.wait, 5.0)
        stopping = loop.time()
    assert loop.time() - stopping < 2.0
    may_open.set()
