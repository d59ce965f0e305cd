"""One connection to NATS."""

import asyncio
import logging
import socket
import ssl
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Final, TypeVar

from nats.aio.msg import Msg
from nats.aio.subscription import Subscription
from nats.errors import Error as NatsError
from nats.errors import SlowConsumerError

from gateway.errors import FleetError
from gateway.fleet.bucket import Bucket, open_bucket
from gateway.fleet.calls import ANSWER_TIME, in_words, reason_of, result
from gateway.fleet.client import MESSAGES_AT_ONCE, TolerantClient
from gateway.fleet.counts import LostMessages
from gateway.fleet.credentials import public_key, read_credentials, sign
from gateway.fleet.headers import text_of
from gateway.fleet.messages import Message
from gateway.fleet.settings import Login, Server
from gateway.ports.network import look_up
from gateway.tls.reasons import explain

#: How long each step of connecting may take, in seconds.
STEP_TIME: Final = 10.0
#: Seconds between pings to the server, and how many of them it may miss before the connection is lost.
PING_INTERVAL: Final = 5.0
MISSED_PINGS: Final = 2
#: The most messages waiting to be sent, and the most bytes in the library's buffer behind them.
MOST_WAITING: Final = 4096
_LARGEST_BUFFER: Final = 256 * 1024
#: The most undelivered messages of one subscription, and their bytes. Further ones are lost.
MOST_UNDELIVERED: Final = 4096
_LARGEST_UNDELIVERED: Final = 4 * 1024 * 1024

T = TypeVar("T")


class NatsConnection:
    """One connection to `server`. Lost messages are not sent again, and a new connection starts empty.

    Answers come to subjects below `inbox`. It begins with the site, so that NATS permissions can keep others from
    listening there. `refused` is called with the reason when the server refuses a subject, `warn` when a bucket is
    unsafe. Messages that are not delivered are counted in `messages`.
    """

    def __init__(
        self,
        server: Server,
        login: Login,
        refused: Callable[[str], None] = lambda _: None,
        messages: LostMessages | None = None,
        warn: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.server = server
        self.inbox = f"_INBOX.{login.site}"
        #: Set to the reason when the connection is lost.
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._login = login
        self._refused = refused
        self._warn = warn
        self._messages = messages or LostMessages()
        self._client = TolerantClient(self._messages)
        self._has_begun = self._is_open = False
        self._outbox: deque[Message] = deque()
        self._has_more = asyncio.Event()
        self._sending: asyncio.Task[None] | None = None
        self._delivered = 0
        self._buckets: dict[str, Bucket] = {}

    @property
    def server_version(self) -> str:
        """The version that the server tells, such as `2.15.1`."""
        return text_of(str(self._client._server_info.get("version", "")))  # noqa: SLF001 - its own property wants semver

    async def open(self) -> None:
        """Connect and log in.

        Raises:
            FleetError: the server cannot be reached, or refuses.
        """
        try:
            async with asyncio.timeout(2 * STEP_TIME):
                await self._connect()
        except TimeoutError:
            raise FleetError(f"it does not answer within {2 * STEP_TIME:g} s") from None
        except NatsError as error:
            raise FleetError(in_words(error)) from error
        except ssl.CertificateError as error:
            raise FleetError(f"its certificate is refused: {error.verify_message}") from error
        except ssl.SSLError as error:
            raise FleetError(explain(error)) from error
        except OSError as error:
            raise FleetError(reason_of(error)) from error
        except (ValueError, UnicodeError) as error:
            raise FleetError(str(error)) from error
        self._is_open = True
        self._sending = asyncio.create_task(self._send(), name="fleet: send")

    def publish(self, message: Message) -> bool:
        """Queue a message. Return False, without sending it, if the connection is not open or the queue is full."""
        if not self._is_open or len(self._outbox) >= MOST_WAITING:
            return False
        self._outbox.append(message)
        self._has_more.set()
        return True

    async def subscribe(
        self, subject: str, deliver: Callable[[Message], None], queue: str = "", most: int = MOST_UNDELIVERED
    ) -> Callable[[], Awaitable[None]]:
        """Deliver messages on `subject`. Each one goes to one member of the group `queue`.

        At most `most` of them wait to be delivered; more are lost and counted. Return a function that ends the
        subscription.

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
        return partial(unsubscribe, await result(subscribe))

    async def bucket(self, name: str) -> Bucket:
        """Open a bucket of the key-value store; create it if it is missing.

        Raises:
            FleetError: the server has no JetStream, or this site may not use or make the bucket.
        """
        known = self._buckets.get(name)
        if known is None:
            stream = self._client.jetstream(timeout=ANSWER_TIME)
            forget = partial(self._buckets.pop, name, None)
            known = self._buckets[name] = await open_bucket(stream, name, forget, self._warn)
        return known

    async def close(self) -> None:
        """Send what is queued, and close. Nothing is delivered afterwards."""
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

    def lose(self, reason: str) -> None:
        """Stop using the connection, and set `lost` to `reason`."""
        self._is_open = False
        self._has_more.set()
        if not self.lost.done():
            self.lost.set_result(reason)

    async def _connect(self) -> None:
        """Connect. Names are looked up here: the library would use threads that hang as long as a name server does."""
        server = self.server
        address = (await look_up(server.host, server.port, socket.SOCK_STREAM, STEP_TIME))[0][4][0]
        options = self._options()
        self._has_begun = True
        await self._client.connect(
            str(Server(address, server.port, server.is_encrypted)),
            name=f"mbgw-{self._login.site}",
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
        # The library does not report that its reading task has ended with a defect.
        assert self._client._reading_task is not None  # noqa: S101, SLF001 - it is connected
        self._client._reading_task.add_done_callback(lambda _: self.lose("it cannot be read any more"))  # noqa: SLF001

    def _options(self) -> dict[str, Any]:
        """Choose the library's options for TLS and login.

        Raises:
            FleetError: the credentials cannot be read.
        """
        server, login = self.server, self._login
        options: dict[str, Any] = {}
        if server.is_encrypted:
            options = {"tls": login.context, "tls_hostname": login.server_name or server.host}
        if login.credentials is not None:
            token, key = read_credentials(login.credentials)
            options["signature_cb"] = lambda nonce: sign(key, self._trusted(nonce))
            if token is not None:
                options["user_jwt_cb"] = lambda: token
            else:  # The library reads it only from a seed, by a package without a wheel.
                self._client._public_nkey = public_key(key)  # noqa: SLF001
        elif login.user is not None:
            options |= {"user": lambda: self._trusted(login.user), "password": login.password or ""}
        return options

    def _trusted(self, what: T) -> T:
        """Return `what` if the server may have it. The library accepts a server without TLS where TLS is required.

        Raises:
            FleetError: the server must offer TLS and does not.
        """
        if self.server.is_encrypted and not self._client._server_info.get("tls_required"):  # noqa: SLF001 - see above
            raise FleetError("it does not offer TLS")
        return what

    async def _send(self) -> None:
        """Send queued messages until the connection is closed or lost."""
        while self._is_open:
            await self._has_more.wait()
            self._has_more.clear()
            while self._outbox:
                sent = self._outbox.popleft()
                try:
                    await self._client.publish(sent.subject, sent.body, sent.reply, headers=_as_dict(sent.headers))
                except NatsError as error:
                    self.lose(in_words(error))
                    return

    async def _deliver(self, deliver: Callable[[Message], None], found: Msg) -> None:
        headers = found.headers
        nobody = headers is not None and not found.data and headers.get("Status") == "503"
        deliver(Message(found.subject, found.data, found.reply, headers, nobody))
        self._delivered += 1
        if self._delivered % MESSAGES_AT_ONCE == 0:
            await asyncio.sleep(0)

    async def _on_error(self, error: Exception) -> None:
        """Fail the attempt while connecting. Afterwards give up the connection only after a defect here."""
        if not self._is_open:
            raise error
        if isinstance(error, SlowConsumerError):
            self._messages.overflowed += 1
        elif "permissions violation" in str(error):
            self._refused(in_words(error))
        elif not isinstance(error, NatsError | OSError):  # raised by a subscriber
            self.lose(f"a defect in the gateway: {error!r}")

    async def _on_closed(self) -> None:
        error = self._client.last_error
        self.lose("the connection was lost" if error is None else in_words(error))


async def unsubscribe(subscription: Subscription) -> None:
    """End a subscription; do nothing if its connection is lost."""
    with suppress(FleetError):
        await result(subscription.unsubscribe())


def _as_dict(headers: Mapping[str, str] | None) -> dict[str, str] | None:
    return dict(headers) if headers else None


# The library logs what it also reports to `error_cb`.
logging.getLogger("nats.aio.client").addHandler(logging.NullHandler())
