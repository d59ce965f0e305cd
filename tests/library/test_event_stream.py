"""A program follows the events of its gateway, at its own pace."""

import asyncio
import gc
from weakref import ref

import pytest

from gateway import events
from gateway.library.event_stream import MOST_WAITING, EventStream, EventStreams


def loss(number: int) -> events.LineLost:
    return events.LineLost("hall", f"/dev/{number}", "unplugged")


CONNECTED = events.ClientConnected(*range(len(events.ClientConnected.field_names)))
AUDIT = events.WriteAudit("embedded", "embedded", 1, 6, 0, 1, "ok", "", 1.0)


@pytest.fixture
def told() -> list[events.Event]:
    """What was handed on."""
    return []


@pytest.fixture
def streams(told) -> EventStreams:
    return EventStreams(told.append)


async def all_of(stream: EventStream) -> list[events.Event]:
    return [event async for event in stream]


async def test_a_stream_has_the_events_from_info_on_since_it_was_opened(streams, told):
    streams.emit(loss(1))
    stream = streams.open()
    for event in CONNECTED, loss(2), AUDIT:
        streams.emit(event)
    streams.close()
    assert await all_of(stream) == [loss(2), AUDIT]
    assert told == [loss(1), CONNECTED, loss(2), AUDIT]


async def test_each_stream_has_all_events_and_waits_for_them(streams):
    readers = [asyncio.create_task(all_of(streams.open())) for _ in range(3)]
    for number in range(3):
        await asyncio.sleep(1)
        streams.emit(loss(number))
    streams.close()
    assert await asyncio.gather(*readers) == [[loss(0), loss(1), loss(2)]] * 3


async def test_a_second_reader_of_one_stream_is_told_so_and_one_after_the_other_is_none(streams):
    stream = streams.open()
    first = asyncio.create_task(anext(stream))
    await asyncio.sleep(1)
    with pytest.raises(RuntimeError, match="open one for each"):
        await anext(stream)
    first.cancel()
    await asyncio.sleep(1)
    second = asyncio.create_task(anext(stream))
    await asyncio.sleep(1)
    streams.emit(loss(1))
    assert await second == loss(1)


async def test_a_stream_that_was_read_to_its_end_stays_so_as_one_opened_later_is(streams):
    stream = streams.open()
    streams.close()
    assert await all_of(stream) == await all_of(stream) == await all_of(streams.open()) == []


async def test_a_wait_that_was_cancelled_loses_nothing(streams):
    stream = streams.open()
    for _ in range(2):
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1):
                await anext(stream)
    waiting = asyncio.create_task(anext(stream))
    await asyncio.sleep(0)
    streams.emit(loss(1))
    waiting.cancel()
    await asyncio.wait([waiting])
    assert await anext(stream) == loss(1)


async def test_what_a_slow_reader_has_missed_is_told_where_it_is_missing(streams):
    stream = streams.open()
    for number in range(MOST_WAITING):
        streams.emit(loss(number))
    for event in AUDIT, loss(-1), AUDIT:
        streams.emit(event)
    assert [await anext(stream) for _ in range(MOST_WAITING)] == [loss(number) for number in range(MOST_WAITING)]
    streams.emit(loss(-2))
    assert [await anext(stream), await anext(stream)] == [events.EventsDropped(3, 2), loss(-2)]


async def test_what_was_missed_last_is_told_at_the_end(streams):
    stream = streams.open()
    for number in range(MOST_WAITING + 5):
        streams.emit(loss(number))
    streams.close()
    assert (await all_of(stream))[MOST_WAITING:] == [events.EventsDropped(5, 0)]


async def test_a_stream_that_nobody_reads_on_is_gone(streams):
    async def read_one() -> ref[EventStream]:
        stream = streams.open()
        async for _ in stream:
            break
        return ref(stream)

    reading = asyncio.create_task(read_one())
    await asyncio.sleep(0)
    streams.emit(loss(1))
    stream = await reading
    del reading
    gc.collect()
    assert stream() is None
    streams.open()
    streams.emit(loss(2))


async def test_any_thread_may_emit(streams):
    stream, number = streams.open(), 1000

    def emit() -> None:
        for each in range(number):
            streams.emit(loss(each))

    threads = [asyncio.to_thread(emit) for _ in range(2)]  # in virtual time one after the other
    await asyncio.gather(*threads)
    streams.close()
    assert len(await all_of(stream)) == 2 * number
