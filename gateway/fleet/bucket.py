"""A bucket of the key-value store of NATS."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final, TypeVar

from nats.js import JetStreamContext
from nats.js.api import KeyValueConfig, StorageType
from nats.js.kv import KeyValue

from gateway.errors import FleetError
from gateway.fleet.calls import ChangedError, NoBucketError, NoKeyError, result
from gateway.fleet.messages import Entry

#: The largest value in a bucket, in bytes.
LARGEST_VALUE: Final = 64 * 1024
#: How many entries are asked for at once.
_QUESTIONS: Final = 32

T = TypeVar("T")


async def open_bucket(stream: JetStreamContext, name: str, forget: Callable[[], object]) -> "Bucket":
    """A bucket, which is made if it is not there; see Bucket.

    Raises:
        FleetError: the server has no JetStream, or this site may not use or make the bucket.
    """
    return Bucket(name, stream, await _open_store(stream, name), forget)


class Bucket:
    """A bucket of the key-value store. Each call may take some seconds.

    All of them raise FleetError if the server does not answer, or refuses, or the bucket was deleted. Then `forget` is
    called, so that who asks the connection for it again has it made again.
    """

    def __init__(self, name: str, stream: JetStreamContext, store: KeyValue, forget: Callable[[], object]) -> None:
        self.name = name
        self._stream = stream
        self._store = store
        self._forget = forget

    async def get(self, key: str) -> Entry | None:
        """What it holds for `key`; None if nothing, or not any more."""
        try:
            entry = await self._result(self._store.get(key))
        except NoKeyError:
            return None
        return Entry(entry.key, entry.value or b"", entry.revision or 0)

    async def create(self, key: str, value: bytes) -> int | None:
        """Put a value where none is. Its revision; None if there is one already."""
        return await self._unless_changed(self._store.create(key, value))

    async def update(self, key: str, value: bytes, revision: int) -> int | None:
        """Replace the value of this `revision`. The new one; None if there is another one meanwhile."""
        return await self._unless_changed(self._store.update(key, value, revision))

    async def put(self, key: str, value: bytes) -> int:
        """Put a value, whatever is there. Its revision."""
        return await self._result(self._store.put(key, value))

    async def entries(self) -> list[Entry]:
        """All that it holds, with times. A few questions at once, one for each key."""
        info = await self._result(self._stream.stream_info(self._stream_name, f"{self._prefix}>"))
        found = await self._ask_for_all(list(info.state.subjects or ()))
        return [each for each in found if each is not None]

    @property
    def _stream_name(self) -> str:
        return f"KV_{self.name}"

    @property
    def _prefix(self) -> str:
        """How the subjects of its keys begin."""
        return f"$KV.{self.name}."

    async def _ask_for_all(self, subjects: list[str]) -> list[Entry | None]:
        places = asyncio.Semaphore(_QUESTIONS)

        async def entry(subject: str) -> Entry | None:
            async with places:
                return await self._entry(subject)

        return await asyncio.gather(*map(entry, subjects))

    async def _entry(self, subject: str) -> Entry | None:
        """The last message on a subject; None if it cannot be read, or says that the key was deleted."""
        try:
            found = await result(self._stream.get_msg(self._stream_name, subject=subject))
        except FleetError:
            return None
        if (found.headers or {}).get("KV-Operation"):
            return None
        created = None if found.time is None else found.time.timestamp()
        return Entry(subject.removeprefix(self._prefix), found.data or b"", found.seq or 0, created)

    async def _unless_changed(self, change: Awaitable[int]) -> int | None:
        try:
            return await self._result(change)
        except ChangedError:
            return None

    async def _result(self, call: Awaitable[T]) -> T:
        """See `result`."""
        try:
            return await result(call)
        except NoBucketError as error:
            self._forget()
            raise FleetError(f"the bucket {self.name} was deleted") from error


async def _open_store(stream: JetStreamContext, name: str) -> KeyValue:
    try:
        return await result(stream.key_value(name))
    except NoBucketError:
        pass
    config = KeyValueConfig(bucket=name, history=1, storage=StorageType.FILE, max_value_size=LARGEST_VALUE)
    try:
        return await result(stream.create_key_value(config))
    except FleetError as error:
        raise FleetError(f"there is no bucket {name}, and it cannot be made: {error}") from error
