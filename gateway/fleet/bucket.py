"""A bucket of the key-value store of NATS."""

import asyncio
from collections.abc import Awaitable, Callable, Collection
from contextlib import suppress
from typing import Final, TypeVar

from nats.js import JetStreamContext
from nats.js.api import DiscardPolicy, StorageType, StreamConfig
from nats.js.kv import KeyValue

from gateway.errors import FleetError
from gateway.fleet.calls import ChangedError, NoBucketError, NoKeyError, result
from gateway.fleet.messages import Entry
from gateway.fleet.subjects import LEASES, STATUS

#: The largest value in a bucket with its headers, in bytes: the state of a line with 247 devices fits.
LARGEST_VALUE: Final = 64 * 1024
#: How long the server remembers message identifiers, in seconds. Gateways send none.
_REMEMBERED: Final = 0.1
#: The most entries requested at once.
_QUESTIONS: Final = 32

T = TypeVar("T")


async def open_bucket(
    stream: JetStreamContext, name: str, forget: Callable[[], object], warn: Callable[[str], None]
) -> "Bucket":
    """Open the bucket `name`; create it if it is missing, and with that of status that of leases.

    `warn` gets what is wrong with an existing one.
    `forget` is called when the bucket turns out to be deleted.

    Raises:
        FleetError: the server has no JetStream, or this site may not use or make the bucket.
    """
    try:
        config = (await result(stream.stream_info(f"KV_{name}"))).config
    except NoBucketError:
        config = await _make(stream, name)
        if name == STATUS:
            # Who may make one may make the other, and may have no lease; the sites that have one may make none.
            with suppress(FleetError):
                await _make(stream, LEASES)
    if wrong := faults(config):
        warn(f"the bucket {name} {' and '.join(wrong)}: delete it, and the next gateway makes it as it must be")
    # Never by direct get: with the right to it, a site could have the server publish what it has stored.
    return Bucket(name, stream, KeyValue(name, f"KV_{name}", f"$KV.{name}.", stream, direct=False), forget)


def faults(config: StreamConfig) -> list[str]:
    """Find what is unsafe in the configuration of a bucket; empty if nothing is."""
    found = {
        "lets each site empty it by a roll-up": config.allow_rollup_hdrs,
        "can be emptied by an answer of the server itself": not config.deny_purge or not config.deny_delete,
        "forgets entries with time": bool(config.max_age),
        "drops old entries when it is full": config.discard != DiscardPolicy.NEW,
    }
    return [what for what, is_so in found.items() if is_so]


class Bucket:
    """A bucket of the key-value store. Each call may take some seconds.

    All calls raise FleetError if the server does not answer or refuses, or if the bucket was deleted. After a deletion
    they call `forget` first, so that the connection creates the bucket again on the next request for it.
    """

    def __init__(self, name: str, stream: JetStreamContext, store: KeyValue, forget: Callable[[], object]) -> None:
        self.name = name
        self._stream = stream
        self._store = store
        self._forget = forget

    async def get(self, key: str) -> Entry | None:
        """Read the entry for `key`; None if there is none or it was deleted."""
        try:
            entry = await self._result(self._store.get(key))
        except NoKeyError:
            return None
        return Entry(entry.key, entry.value or b"", entry.revision or 0)

    async def create(self, key: str, value: bytes) -> int | None:
        """Write a value for a key without one. Return its revision; None if there is a value already."""
        return await self._unless_changed(self._store.create(key, value))

    async def update(self, key: str, value: bytes, revision: int) -> int | None:
        """Replace the value of this `revision`. Return the new revision; None if the entry has changed since."""
        return await self._unless_changed(self._store.update(key, value, revision))

    async def put(self, key: str, value: bytes) -> int:
        """Write a value in any case. Return its revision."""
        return await self._result(self._store.put(key, value))

    async def entries(self, only: Collection[str] | None = None) -> list[Entry]:
        """Read all entries, or those for these keys, with times, a few at once; one that cannot be read is empty."""
        if only is None:
            info = await self._result(self._stream.stream_info(self._stream_name, f"{self._prefix}>"))
            subjects = list(info.state.subjects or ())
        else:
            subjects = [f"{self._prefix}{key}" for key in only]
        found = await self._ask_for_all(subjects)
        return [each for each in found if each is not None]

    @property
    def _stream_name(self) -> str:
        return f"KV_{self.name}"

    @property
    def _prefix(self) -> str:
        """Beginning of the subjects of its keys."""
        return f"$KV.{self.name}."

    async def _ask_for_all(self, subjects: list[str]) -> list[Entry | None]:
        found: list[Entry | None] = []
        for first in range(0, len(subjects), _QUESTIONS):
            found += await asyncio.gather(*map(self._entry, subjects[first : first + _QUESTIONS]))
        return found

    async def _entry(self, subject: str) -> Entry | None:
        """Read the last message on a subject; None if there is none or it marks a deletion."""
        key = subject.removeprefix(self._prefix)
        try:
            found = await result(self._stream.get_msg(self._stream_name, subject=subject))
        except (NoKeyError, NoBucketError):  # the server says the same for a subject without a message
            return None
        except FleetError:
            return Entry(key, b"", 0)
        if (found.headers or {}).get("KV-Operation"):
            return None
        created = None if found.time is None else found.time.timestamp()
        return Entry(key, found.data or b"", found.seq or 0, created)

    async def _unless_changed(self, change: Awaitable[int]) -> int | None:
        try:
            return await self._result(change)
        except ChangedError:
            return None

    async def _result(self, call: Awaitable[T]) -> T:
        """Await a call; see `result`. A deleted bucket is forgotten."""
        try:
            return await result(call)
        except NoBucketError as error:
            self._forget()
            raise FleetError(f"the bucket {self.name} was deleted") from error


async def _make(stream: JetStreamContext, name: str) -> StreamConfig:
    """Create a bucket in which a site can change only the keys that it may write.

    The default configuration of the library allows roll-up and purges.
    """
    config = StreamConfig(
        name=f"KV_{name}",
        subjects=[f"$KV.{name}.>"],
        max_msgs_per_subject=1,
        max_msg_size=LARGEST_VALUE,
        discard=DiscardPolicy.NEW,
        storage=StorageType.FILE,
        duplicate_window=_REMEMBERED,
        deny_delete=True,
        deny_purge=True,
        allow_rollup_hdrs=False,
    )
    try:
        return (await result(stream.add_stream(config))).config
    except FleetError as error:
        raise FleetError(f"there is no bucket {name}, and it cannot be made: {error}") from error
