"""A bucket of the key-value store, with a server that answers when the event loop comes round."""

import asyncio
from types import SimpleNamespace

import pytest
from nats.errors import Error
from nats.js.errors import NotFoundError

from gateway.fleet.bucket import Bucket
from gateway.fleet.messages import Entry

EMPTY = Entry("0", b"", 0)


class Stream:
    """A bucket of many keys. `most` is the largest number of questions at once, and of tasks."""

    def __init__(self, keys: int) -> None:
        self.subjects = {f"$KV.status.{number}": 1 for number in range(keys)}
        self.most = 0

    async def stream_info(self, *_: object) -> object:
        return SimpleNamespace(state=SimpleNamespace(subjects=self.subjects))

    async def get_msg(self, _: str, *, subject: str, **__: object) -> object:
        self.most = max(self.most, len(asyncio.all_tasks()))
        await asyncio.sleep(0.01)
        return SimpleNamespace(headers=None, time=None, data=subject.encode(), seq=1)


async def test_a_bucket_of_many_keys_is_read_with_few_tasks():
    stream = Stream(1000)
    found = await Bucket("status", stream, None, lambda: None).entries()
    assert [each.key for each in found] == [str(number) for number in range(1000)]
    assert stream.most <= 40


@pytest.mark.parametrize(("error", "found"), [(ValueError, [EMPTY]), (Error, [EMPTY]), (NotFoundError, [])])
async def test_what_cannot_be_read_is_an_empty_entry_and_what_is_not_there_none(error, found, monkeypatch):
    stream = Stream(1)

    async def fail(*_: object, **__: object) -> object:
        raise error

    monkeypatch.setattr(stream, "get_msg", fail)
    assert await Bucket("status", stream, None, lambda: None).entries() == found
