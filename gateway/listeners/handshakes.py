"""Connections whose handshake is not done yet: a bounded number, for a bounded time.

The work is done in a thread of its own, one step at a time and for a share of the time only, so that clients of other
listeners do not wait for it (docs/adr/0021-modbus-security.md).
"""

import asyncio
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Final

from gateway.listeners.tls_stream import TlsStream
from gateway.listeners.turns import Turns

#: How many there may be at a listener, and of them from one address.
MOST: Final = 64
MOST_OF_ONE: Final = 8
#: How long a handshake may take, in seconds: small devices with RSA need some.
DEADLINE: Final = 10.0
#: A client that has said nothing for this long, in seconds, makes room for one of an address with only one fewer. Else
#: clients that all come at once would end each other's handshakes, those that are nearly done first.
SILENT: Final = 1.0

TOO_MANY_OF_ONE: Final = f"{MOST_OF_ONE} handshakes with this address are not done"
TOO_MANY: Final = f"{MOST} handshakes are not done, and others have fewer of them"
MADE_ROOM: Final = "its handshake was not done, and made room for that of another address"
TOO_SLOW: Final = f"its handshake was not done within {DEADLINE:g} s"


@dataclass(frozen=True, slots=True)
class ConnectingClient:
    """Where a connection comes from: its address, its name in events, and what counts as its address.

    `resumable_until` as in gateway.tls.contexts.Loaded.
    """

    host: str
    client: str
    origin: str
    resumable_until: float = inf


class Handshakes:
    """The handshakes of one listener. `secured` is told of each that is done, `refused` of each that is not."""

    def __init__(
        self, secured: Callable[[TlsStream, ConnectingClient], None], refused: Callable[[ConnectingClient, str], None]
    ) -> None:
        self._secured = secured
        self._refused = refused
        #: By stream, in the order in which they began.
        self._pending: dict[TlsStream, tuple[ConnectingClient, float]] = {}
        #: Since when the next bytes of a client are awaited; not while a step is due, or under way.
        self._awaited: dict[TlsStream, float] = {}
        self._worker: ThreadPoolExecutor | None = None
        self._turns: Turns[TlsStream] = Turns()
        self._is_working = False
        self._pausing: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self._pending)

    def trouble(self, origin: str, now: float) -> str:
        """Why no handshake can begin with a client from there; empty if it can, perhaps after another was ended."""
        share = Counter(connecting.origin for connecting, _ in self._pending.values())
        if share[origin] >= MOST_OF_ONE:
            return TOO_MANY_OF_ONE
        if len(self._pending) < MOST:
            return ""
        most = max(share.values())
        if most <= share[origin]:
            return TOO_MANY
        of_most = [stream for stream, (connecting, _) in self._pending.items() if share[connecting.origin] == most]
        if most == share[origin] + 1:
            of_most = [stream for stream in of_most if now - self._awaited.get(stream, now) >= SILENT]
        if not of_most:
            return TOO_MANY
        of_most[0].refuse(MADE_ROOM)
        return ""

    def begin(self, stream: TlsStream, connecting: ConnectingClient, now: float) -> None:
        """A client has connected."""
        self._pending[stream] = connecting, now
        self._awaited[stream] = now
        stream.start()

    def sweep(self, now: float) -> None:
        """End those that take too long; called periodically."""
        for stream, (_, began_at) in list(self._pending.items()):
            if now - began_at < DEADLINE:
                return
            stream.refuse(TOO_SLOW)

    def close(self) -> None:
        """End all of them."""
        for stream in list(self._pending):
            del self._pending[stream]
            stream.abort()
        self._awaited.clear()
        self._turns.clear()
        if self._pausing is not None:
            self._pausing.cancel()
            self._pausing = None
        if self._worker is not None:
            self._worker.shutdown(wait=False, cancel_futures=True)
            self._worker = None

    def step_due(self, stream: TlsStream) -> None:
        """See HandshakeOwner."""
        if stream in self._pending:
            self._awaited.pop(stream, None)
            self._turns.add(stream, self._pending[stream][0].origin)
            self._go_on()

    def secured(self, stream: TlsStream) -> None:
        """See HandshakeOwner."""
        connecting, _ = self._pending.pop(stream)
        self._awaited.pop(stream, None)
        self._secured(stream, connecting)

    def not_secured(self, stream: TlsStream, reason: str) -> None:
        """See HandshakeOwner."""
        pending = self._pending.pop(stream, None)
        self._awaited.pop(stream, None)
        if pending is not None:
            self._turns.drop(stream, pending[0].origin)
            self._refused(pending[0], reason)

    def _go_on(self) -> None:
        """Begin the next step, if none is under way and it is time for one."""
        if self._is_working or self._pausing is not None:
            return
        loop = asyncio.get_running_loop()
        pause = self._turns.pause(loop.time())
        if pause:
            self._pausing = loop.call_later(pause, self._resume)
            return
        stream = self._turns.next()
        if stream is not None:
            self._begin_step(stream)

    def _resume(self) -> None:
        self._pausing = None
        self._go_on()

    def _begin_step(self, stream: TlsStream) -> None:
        if self._worker is None:
            self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="tls handshakes")
        loop = asyncio.get_running_loop()
        self._is_working = True
        step = loop.run_in_executor(self._worker, stream.step)
        step.add_done_callback(partial(self._stepped, stream, loop.time()))

    def _stepped(self, stream: TlsStream, began_at: float, step: asyncio.Future[str | None]) -> None:
        self._is_working = False
        try:
            if not step.cancelled():
                stream.stepped(step.result())
        finally:
            now = asyncio.get_running_loop().time()
            if stream in self._pending:
                self._awaited[stream] = now
            self._turns.took(now - began_at, now)
            self._go_on()
