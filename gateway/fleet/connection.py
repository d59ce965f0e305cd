"""One connection to NATS: the only module that knows the library."""

import asyncio
import base64
import logging
import os
import socket
import ssl
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.aio.subscription import Subscription as NatsSubscription
from nats.errors import Error as NatsError
from nats.errors import NoRespondersError, SlowConsumerError
from nats.js import JetStreamContext
from nats.js.api import KeyValueConfig, StorageType
from nats.js.errors import (
    APIError,
    KeyNotFoundError,
    KeyWrongLastSequenceError,
    NoStreamResponseError,
    NotFoundError,
    ServiceUnavailableError,
)
from nats.js.kv import KeyValue

from gateway.errors import FleetError
from gateway.fleet.counts import LostMessages
from gateway.fleet.messages import Entry, Message
from gateway.ports.lookup import look_up
from gateway.tls.reasons import explain

#: How long each step of connecting, and a question to the server, may take, in seconds.
STEP_TIME: Final = 10.0
ANSWER_TIME: Final = 3.0
#: How often the server is asked whether it is there, in seconds; the connection is lost when it misses two of these.
PING_INTERVAL: Final = 5.0
MISSED_PINGS: Final = 2
#: The most messages that wait to be sent, and the most bytes that the library holds after that.
MOST_WAITING: Final = 4096
_LARGEST_BUFFER: Final = 256 * 1024
#: The most messages of one subscription that wait to be delivered, and their bytes. What comes beyond that is lost.
MOST_UNDELIVERED: Final = 4096
_LARGEST_UNDELIVERED: Final = 4 * 1024 * 1024
#: After so many messages other work has its turn.
_MESSAGES_AT_ONCE: Final = 16
#: The shortest and the longest block of headers that the library may read: the first line with its end and an empty
#: line, and several times what gateways send.
_SHORTEST_HEADERS: Final = 12
_LONGEST_HEADERS: Final = 4096
#: How many questions about a bucket are asked at once.
_QUESTIONS: Final = 32
#: The largest value in a bucket, in bytes.
LARGEST_VALUE: Final = 64 * 1024

_NO_JETSTREAM: Final = "this NATS server has no JetStream, or not for this account: start it with --jetstream"
_SEED_LINE: Final = "BEGIN USER NKEY SEED"
_JWT_LINE: Final = "BEGIN NATS USER JWT"
#: A seed is two bytes of what it is for, 32 of key and two of check sum.
_SEED: Final = slice(2, 34)
_SEED_SIZE: Final = 36

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Server:
    """Where a NATS server is. With `is_encrypted` the connection is one of TLS, or there is none."""

    host: str
    port: int
    is_encrypted: bool = False

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'tls' if self.is_encrypted else 'nats'}://{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class Login:
    """How the gateway of `site` logs in: with user and password, or with the text of a credentials file."""

    site: str
    user: str | None = None
    password: str | None = None
    credentials: str | None = None
    context: ssl.SSLContext | None = None
    server_name: str = ""


class _Reader(Client):
    """The library, which stops reading for good when one message cannot be decoded: such messages are dropped here."""

    def __init__(self, lost: LostMessages) -> None:
        super().__init__()
        self._lost = lost
        self._read = 0

    async def _process_msg(self, sid: int, subject: bytes, reply: bytes, data: bytes, headers: bytes) -> None:
        self._read += 1
        if self._read % _MESSAGES_AT_ONCE == 0:
            await asyncio.sleep(0)
        try:
            _check(subject, reply, headers)
            await super()._process_msg(sid, subject, reply, data, headers)
        except (ValueError, LookupError):
            self._lost.unreadable += 1


class Connection:
    """A connection to `server`. What it loses is not sent again: the next connection begins with nothing.

    Answers come to subjects below `inbox`, which begins with the site, so that the permissions of NATS can keep others
    from listening there. `refused` is called when the server refuses a subject, with the reason. Messages that are not
    delivered are counted in `messages`.
    """

    def __init__(
        self,
        server: Server,
        login: Login,
        refused: Callable[[str], None] = lambda _: None,
        messages: LostMessages | None = None,
    ) -> None:
        self.server = server
        self.inbox = f"_INBOX.{login.site}"
        self._login = login
        self._refused = refused
        self._loop = asyncio.get_running_loop()
        #: Done when the connection is lost, with the reason.
        self.lost: asyncio.Future[str] = self._loop.create_future()
        self._messages = messages or LostMessages()
        self._client = _Reader(self._messages)
        self._has_begun = self._is_open = False
        self._outbox: deque[Message] = deque()
        self._has_more = asyncio.Event()
        self._sending: asyncio.Task[None] | None = None
        self._delivered = 0
        self._buckets: dict[str, Bucket] = {}

    async def open(self) -> None:
        """Connect and log in.

        Raises:
            FleetError: it cannot be reached, or refuses.
        """
        try:
            async with asyncio.timeout(2 * STEP_TIME):
                await self._connect()
        except TimeoutError:
            raise FleetError(f"it does not answer within {2 * STEP_TIME:g} s") from None
        except NatsError as error:
            raise FleetError(_in_words(error)) from error
        except ssl.CertificateError as error:
            raise FleetError(f"its certificate is refused: {error.verify_message}") from error
        except ssl.SSLError as error:
            raise FleetError(explain(error)) from error
        except OSError as error:
            raise FleetError(_reason(error)) from error
        except (ValueError, UnicodeError) as error:
            raise FleetError(str(error)) from error
        self._is_open = True
        self._sending = asyncio.create_task(self._send(), name="fleet: send")

    def publish(self, message: Message) -> bool:
        """Send a message. False, and nothing is sent, if too many wait."""
        if not self._is_open or len(self._outbox) >= MOST_WAITING:
            return False
        self._outbox.append(message)
        self._has_more.set()
        return True

    async def subscribe(
        self, subject: str, deliver: Callable[[Message], None], queue: str = "", most: int = MOST_UNDELIVERED
    ) -> Callable[[], Awaitable[None]]:
        """Have what comes on `subject` delivered; one member of the group `queue` gets each message.

        At most so many wait to be delivered; more are lost, and counted. Returns what ends the subscription.

        Raises:
            FleetError: the connection is lost.
        """
        subscribe = self._client.subscribe(
            subject,
            queue,
            partial(self._deliver, deliver),
            pending_msgs_limit=most,
            pending_bytes_limit=_LARGEST_UNDELIVERED,
        )
        subscription = await _answered(subscribe)
        return partial(_end, subscription)

    async def settle(self) -> None:
        """Wait until the server has taken all that was said before.

        Raises:
            FleetError: the connection is lost.
        """
        await _answered(self._client.flush(int(ANSWER_TIME)))

    async def bucket(self, name: str) -> "Bucket":
        """A bucket of the key-value store, which is made if it is not there.

        Raises:
            FleetError: the server has no JetStream, or this site may not use or make the bucket.
        """
        known = self._buckets.get(name)
        if known is None:
            stream = self._client.jetstream(timeout=ANSWER_TIME)
            store = await _open_store(stream, name)
            known = self._buckets[name] = Bucket(name, stream, store, partial(self._buckets.pop, name, None))
        return known

    async def close(self) -> None:
        """Send what waits, and close it. Nothing is delivered any more."""
        self._is_open = False
        self._has_more.set()
        if self._sending is not None:
            await asyncio.wait((self._sending,), timeout=ANSWER_TIME)
            self._sending.cancel()
        if self._has_begun:
            with suppress(TimeoutError, NatsError, OSError, RuntimeError):
                async with asyncio.timeout(ANSWER_TIME):
                    await self._client.close()
        self.lose("it was closed")

    async def _connect(self) -> None:
        """Connect. The library looks up names in threads that hang as long as a name server does; ours do not."""
        server, login = self.server, self._login
        address = (await look_up(server.host, server.port, socket.SOCK_STREAM, STEP_TIME))[0][4][0]
        options: dict[str, Any] = {}
        if server.is_encrypted:
            options = {"tls": login.context, "tls_hostname": login.server_name or server.host}
        if login.credentials is not None:
            token, key = _read_credentials(login.credentials)
            options |= {"user_jwt_cb": lambda: self._trusted(token), "signature_cb": partial(_sign, key)}
        elif login.user is not None:
            options |= {"user": lambda: self._trusted(login.user), "password": login.password or ""}
        self._has_begun = True
        await self._client.connect(
            str(Server(address, server.port, server.is_encrypted)),
            name=f"mbgw-{login.site}",
            allow_reconnect=False,
            max_reconnect_attempts=1,
            connect_timeout=int(STEP_TIME),
            ping_interval=int(PING_INTERVAL),
            max_outstanding_pings=MISSED_PINGS,
            pending_size=_LARGEST_BUFFER,
            inbox_prefix=self.inbox,
            error_cb=self._on_error,
            closed_cb=self._on_closed,
            **options,
        )
        self._trusted(None)
        # When it stops reading because of a defect, the library tells nobody.
        assert self._client._reading_task is not None  # noqa: S101, SLF001 - it is connected
        self._client._reading_task.add_done_callback(lambda _: self.lose("it cannot be read any more"))  # noqa: SLF001

    def _trusted(self, what: T) -> T:
        """`what`, if the server may have it: the library does not mind when one that should have TLS says it has none.

        Raises:
            FleetError: it may not.
        """
        if self.server.is_encrypted and not self._client._server_info.get("tls_required"):  # noqa: SLF001 - see above
            raise FleetError("it does not offer TLS")
        return what

    async def _send(self) -> None:
        """Send what waits, until the connection is lost or to be closed."""
        while self._is_open:
            await self._has_more.wait()
            self._has_more.clear()
            while self._outbox:
                message = self._outbox.popleft()
                try:
                    await self._client.publish(
                        message.subject, message.body, message.reply, headers=_sent(message.headers)
                    )
                except NatsError as error:
                    self.lose(_in_words(error))
                    return

    async def _deliver(self, deliver: Callable[[Message], None], found: Msg) -> None:
        headers = found.headers
        nobody = headers is not None and not found.data and headers.get("Status") == "503"
        deliver(Message(found.subject, found.data, found.reply, headers, nobody))
        self._delivered += 1
        if self._delivered % _MESSAGES_AT_ONCE == 0:
            await asyncio.sleep(0)

    async def _on_error(self, error: Exception) -> None:
        """While it connects, any error ends the attempt; later, only those after which it is closed."""
        if not self._is_open:
            raise error
        if isinstance(error, SlowConsumerError):
            self._messages.overflowed += 1
        elif "permissions violation" in str(error):
            self._refused(_in_words(error))
        elif not isinstance(error, NatsError | OSError):  # of what messages are delivered to
            self.lose(f"a defect in the gateway: {error!r}")

    async def _on_closed(self) -> None:
        error = self._client.last_error
        self.lose("the connection was lost" if error is None else _in_words(error))

    def lose(self, reason: str) -> None:
        """Use it no more; `lost` says why."""
        self._is_open = False
        self._has_more.set()
        if not self.lost.done():
            self.lost.set_result(reason)


class Bucket:
    """A bucket of the key-value store. Each call may take some seconds.

    All of them raise FleetError if the server does not answer, or refuses, or the bucket was deleted. Then `forget` is
    called, so that who asks the connection for it again has it made again.
    """

    def __init__(self, name: str, stream: JetStreamContext, store: KeyValue, forget: Callable[[], object]) -> None:
        self.name = name
        self._forget = forget
        self._stream = stream
        self._store = store

    async def get(self, key: str) -> Entry | None:
        """What it holds for `key`; None if nothing, or not any more."""
        try:
            entry = await self._told(self._store.get(key))
        except _NotThereError:
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
        return await self._told(self._store.put(key, value))

    async def delete(self, key: str, revision: int | None = None) -> bool:
        """Delete the value, of this `revision` only. False if there is another one meanwhile."""
        try:
            await self._told(self._store.delete(key, revision))
        except _ChangedError:
            return False
        return True

    async def entries(self) -> list[Entry]:
        """All that it holds, with times. A few questions at once, one for each key."""
        prefix, stream = f"$KV.{self.name}.", f"KV_{self.name}"
        info = await self._told(self._stream.stream_info(stream, f"{prefix}>"))
        turn = asyncio.Semaphore(_QUESTIONS)

        async def entry(subject: str) -> Entry | None:
            async with turn:
                try:
                    found = await _answered(self._stream.get_msg(stream, subject=subject))
                except FleetError:
                    return None
            is_there = not (found.headers or {}).get("KV-Operation")
            created = None if found.time is None else found.time.timestamp()
            return Entry(subject.removeprefix(prefix), found.data or b"", found.seq or 0, created) if is_there else None

        found = await asyncio.gather(*map(entry, info.state.subjects or ()))
        return [each for each in found if each is not None]

    async def _unless_changed(self, change: Awaitable[int]) -> int | None:
        try:
            return await self._told(change)
        except _ChangedError:
            return None

    async def _told(self, call: Awaitable[T]) -> T:
        """As `_answered`."""
        try:
            return await _answered(call)
        except _NoBucketError as error:
            self._forget()
            raise FleetError(f"the bucket {self.name} was deleted") from error


class _NotThereError(FleetError):
    """The bucket has nothing for the key."""


class _NoBucketError(FleetError):
    """There is no such bucket."""


class _ChangedError(FleetError):
    """Another one has changed the value."""


async def _answered(call: Awaitable[T]) -> T:
    """What a call of the library returns.

    Raises:
        FleetError: what the library raises, in words.
    """
    try:
        async with asyncio.timeout(2 * ANSWER_TIME):
            return await call
    except NotFoundError as error:
        raise _what_is_missing(error) from error
    except KeyWrongLastSequenceError as error:
        raise _ChangedError(str(error)) from error
    except ServiceUnavailableError as error:
        raise FleetError(error.description or _NO_JETSTREAM) from error
    except APIError as error:
        kind = _ChangedError if error.err_code in _CHANGED else FleetError
        raise kind(error.description or str(error)) from error
    except (NoRespondersError, NoStreamResponseError) as error:
        raise _NoBucketError(_in_words(error)) from error
    except NatsError as error:
        raise FleetError(_in_words(error)) from error
    except TimeoutError:
        raise FleetError("it does not answer; this site may have no right to ask that") from None
    except OSError as error:
        raise FleetError(_reason(error)) from error
    except (ValueError, LookupError) as error:  # what another site has put there, with headers of its own
        raise FleetError("what it holds cannot be read") from error


def _what_is_missing(error: NotFoundError) -> FleetError:
    """The library says that a key is not found also without a bucket; what it was told says which of the two it is."""
    is_key = isinstance(error, KeyNotFoundError) and getattr(error.__context__, "err_code", None) != _NO_STREAM
    return _NotThereError(str(error)) if is_key else _NoBucketError(str(error))


#: The error codes of JetStream for a value that has changed meanwhile, and for a stream that is not there.
_CHANGED: Final = (10071, 10164)
_NO_STREAM: Final = 10059


async def _open_store(stream: JetStreamContext, name: str) -> KeyValue:
    try:
        return await _answered(stream.key_value(name))
    except _NoBucketError:
        pass
    config = KeyValueConfig(bucket=name, history=1, storage=StorageType.FILE, max_value_size=LARGEST_VALUE)
    try:
        return await _answered(stream.create_key_value(config))
    except FleetError as error:
        raise FleetError(f"there is no bucket {name}, and it cannot be made: {error}") from error


def _check(subject: bytes, reply: bytes, headers: bytes) -> None:
    """Raise ValueError if the library could not read this, or would take long for it."""
    subject.decode()
    reply.decode()
    if headers and not _SHORTEST_HEADERS <= len(headers) <= _LONGEST_HEADERS:
        raise ValueError


async def _end(subscription: NatsSubscription) -> None:
    with suppress(FleetError):
        await _answered(subscription.unsubscribe())


def _sent(headers: Mapping[str, str] | None) -> dict[str, str] | None:
    return dict(headers) if headers else None


def _reason(error: OSError) -> str:
    """What the system says; asyncio says more, with an address of its own choice."""
    number = error.errno or 0
    return os.strerror(number) if number > 0 else error.strerror or str(error)


def _in_words(error: Exception) -> str:
    """What the library raises, for people."""
    text = str(error).removeprefix("nats:").strip().strip("'")
    lower = text.lower()
    if "authorization violation" in lower or "authentication" in lower:
        return "it refuses this user: user, password or credentials are wrong"
    if isinstance(error, NoRespondersError | NoStreamResponseError):
        return _NO_JETSTREAM
    if "permissions violation" in lower:
        return f"it has no right to {text[len('permissions violation for ') :]}"
    return text or type(error).__name__


def _read_credentials(text: str) -> tuple[bytes, bytes]:
    """The token and the private key in a credentials file.

    Raises:
        FleetError: it has none.
    """
    token, seed = _line_behind(_JWT_LINE, text), _line_behind(_SEED_LINE, text)
    try:
        raw = base64.b32decode(seed + "=" * (-len(seed) % 8))
    except ValueError:
        raw = b""
    if not token or len(raw) != _SEED_SIZE:
        raise FleetError("it is not a credentials file: that has the token and the seed of a user")
    return token.encode(), raw[_SEED]


def _line_behind(marker: str, text: str) -> str:
    lines = iter(text.splitlines())
    return next((next(lines, "").strip() for line in lines if marker in line), "")


def _sign(key: bytes, nonce: str) -> bytes:
    """The signature of what the server asks to be signed.

    Raises:
        FleetError: the library for it is not installed.
    """
    try:
        from nacl.signing import SigningKey  # noqa: PLC0415 - only with `credentials`, and not everywhere there is one
    except ModuleNotFoundError as error:
        raise FleetError(
            "a credentials file needs PyNaCl, which is not installed: apt install python3-nacl, or pip install pynacl"
        ) from error

    return base64.b64encode(SigningKey(key).sign(nonce.encode()).signature)


# The library logs what it also reports.
logging.getLogger("nats.aio.client").addHandler(logging.NullHandler())
