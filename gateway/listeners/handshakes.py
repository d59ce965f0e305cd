"""Connections during their handshake: a limited number, for a limited time.

A separate thread does the work, one step at a time and for a share of a processor only, so that clients of other
listeners do not wait for it (docs/adr/0021-modbus-security.md).
"""

import asyncio
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import inf
from time import thread_time
from typing import Final

from gateway.listeners.handshake_turns import Turns
from gateway.listeners.tls_stream import TlsStream
from gateway.request import Caller

#: The most handshakes at a listener.
MOST: Final = 64
#: The limit of a handshake, in seconds: small devices with RSA need some.
DEADLINE: Final = 10.0
#: If there are too many, the slowest client of the address with most of them makes room. Unless that address has at
#: least two more than the new client's, it must have been awaited for this many seconds: otherwise clients that come at
#: once would end one another's handshakes.
SLOW: Final = 1.0

TOO_MANY: Final = f"{MOST} handshakes are in progress, and no client that could make room is slow"
MADE_ROOM: Final = "its handshake was not done, and made room for another one"
TOO_SLOW: Final = f"its handshake was not done within {DEADLINE:g} s"


@dataclass(frozen=True, slots=True)
class ConnectingClient:
    """A client whose handshake is not done."""

    caller: Caller
    #: See gateway.tls.contexts.Loaded.
    resumable_until: float = inf


@dataclass(slots=True)
class _Handshake:
    """A handshake that is not done."""

    connecting: ConnectingClient
    began_at: float
    #: Since when the client's bytes are awaited; None while a step is due or under way.
    awaited_at: float | None
    #: Seconds of earlier waiting since the client was last sent something.
    awaited: float = 0.0

    def delay(self, now: float) -> float:
        """Return the seconds of waiting for the client since it was last sent something."""
        return self.awaited + (0.0 if self.awaited_at is None else now - self.awaited_at)


class Handshakes:
    """The handshakes of one listener. `secured` is called for each that succeeds, `rejected` for each that fails."""

    def __init__(
        self, secured: Callable[[TlsStream, ConnectingClient], None], rejected: Callable[[ConnectingClient, str], None]
    ) -> None:
        self._secured = secured
        self._rejected = rejected
        #: By stream, oldest first.
        self._pending: dict[TlsStream, _Handshake] = {}
        self._worker: ThreadPoolExecutor | None = None
        self._turns: Turns[TlsStream] = Turns()
        self._is_working = False
        self._pausing: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self._pending)

    def make_room(self, share_key: str, now: float) -> str:
        """Make room for a client with this share key, perhaps by ending a handshake. Return why there is none."""
        if len(self._pending) < MOST:
            return ""
        share = Counter(handshake.connecting.caller.share_key for handshake in self._pending.values())
        most = max(share.values())
        delays = {
            stream: handshake.delay(now)
            for stream, handshake in self._pending.items()
            if share[handshake.connecting.caller.share_key] == most
        }
        slowest = max(delays, key=delays.__getitem__)
        if most <= share[share_key] + 1 and delays[slowest] < SLOW:
            return TOO_MANY
        slowest.reject(MADE_ROOM)
        return ""

    def begin(self, stream: TlsStream, connecting: ConnectingClient, now: float) -> None:
        """Start the handshake of a new client."""
        self._pending[stream] = _Handshake(connecting, now, now)
        stream.start()

    def sweep(self, now: float) -> None:
        """End handshakes that take too long; called periodically."""
        for stream, handshake in list(self._pending.items()):
            if now - handshake.began_at < DEADLINE:
                return
            stream.reject(TOO_SLOW)

    def close(self) -> None:
        """End all handshakes."""
        for stream in list(self._pending):
            del self._pending[stream]
            stream.abort()
        self._turns.clear()
        if self._pausing is not None:
            self._pausing.cancel()
            self._pausing = None
        if self._worker is not None:
            self._worker.shutdown(wait=False, cancel_futures=True)
            self._worker = None

    def step_due(self, stream: TlsStream) -> None:
        """Queue the next step of this stream."""
        handshake = self._pending.get(stream)
        if handshake is not None:
            handshake.awaited, handshake.awaited_at = handshake.delay(asyncio.get_running_loop().time()), None
            self._turns.add(stream, handshake.connecting.caller.share_key)
            self._go_on()

    def secured(self, stream: TlsStream) -> None:
        """Pass on a connection whose handshake is done."""
        self._secured(stream, self._pending.pop(stream).connecting)

    def not_secured(self, stream: TlsStream, reason: str) -> None:
        """Pass on a failed handshake."""
        handshake = self._pending.pop(stream, None)
        if handshake is not None:
            self._turns.drop(stream, handshake.connecting.caller.share_key)
            self._rejected(handshake.connecting, reason)

    def _go_on(self) -> None:
        """Start the next step, if none is under way and it is time for one."""
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
        self._is_working = True
        step = asyncio.get_running_loop().run_in_executor(self._worker, _take_step, stream)
        step.add_done_callback(partial(self._stepped, stream))

    def _stepped(self, stream: TlsStream, step: asyncio.Future[tuple[str | None, float]]) -> None:
        self._is_working = False
        has_response, seconds = stream.has_response, 0.0
        try:
            if not step.cancelled():
                outcome, seconds = step.result()
                stream.stepped(outcome)
        finally:
            now = asyncio.get_running_loop().time()
            handshake = self._pending.get(stream)
            if handshake is not None:
                handshake.awaited_at = now
                if has_response:
                    handshake.awaited = 0.0
            self._turns.took(seconds, now)
            self._go_on()


def _take_step(stream: TlsStream) -> tuple[str | None, float]:
    """Take a step. Return its outcome and its processor time, which excludes pauses of the machine."""
    began = thread_time()
    return stream.step(), thread_time() - began
