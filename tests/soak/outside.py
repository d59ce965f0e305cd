"""What goes on outside a gateway that stands still, in virtual time: clients send, and the system keeps it for them."""

import asyncio
import random
from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from math import inf

from gateway.listeners.connection import TcpConnection


class Outside:
    """Events with a clock of their own, which goes on while the gateway stands still. None of them calls the gateway.

    The gateway can be `armed` to stand still for so many seconds when it comes by a point of its own code.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._at = self._loop.time()
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = count()
        self.armed: tuple[str, float] | None = None
        #: When the gateway goes on, or last went on.
        self.goes_on_at = -inf

    @property
    def now(self) -> float:
        """The time of whatever happens now, outside or in the gateway."""
        return max(self._at, self._loop.time())

    def call_later(self, seconds: float, callback: Callable[[], None]) -> None:
        """Have something happen outside."""
        at = self.now + seconds
        heappush(self._events, (at, next(self._numbers), callback))
        self._loop.call_at(at, self._happen, at)

    def stand_still(self, seconds: float) -> None:
        """The gateway does nothing for a while."""
        self.goes_on_at = self._loop.time() + seconds
        self._happen(self.goes_on_at)
        self._loop.stand_still(seconds)

    def pass_by(self, point: str) -> None:
        """The gateway comes by this point of its code, and may stand still there."""
        if self.armed is not None and self.armed[0] == point:
            (_, seconds), self.armed = self.armed, None
            self.stand_still(seconds)

    def _happen(self, until: float) -> None:
        while self._events and self._events[0][0] <= until:
            self._at, _, event = heappop(self._events)
            event()


class Socket:
    """A client's connection as the gateway has it, in place of TcpStream, and what the system keeps of what was sent.

    The loop calls a few other callbacks before it reads. `heard` takes what the gateway sends.
    """

    def __init__(
        self, outside: Outside, dice: random.Random, user: TcpConnection, heard: Callable[[bytes], None]
    ) -> None:
        self._outside = outside
        self._loop = asyncio.get_running_loop()
        self._dice = dice
        self._user = user
        self._heard = heard
        self._unread = bytearray()
        self._is_reading = self._is_due = False
        #: How many bytes were sent to the gateway, and how many of them it has read.
        self.sent = self.read = 0

    def arrive(self, data: bytes) -> None:
        """The client has sent this."""
        self.sent += len(data)
        self._unread += data
        self._become_due()

    # --- what the connection sees ---

    def is_closing(self) -> bool:
        return False

    def set_write_buffer_limits(self, high: int) -> None:
        pass

    def pause_reading(self) -> None:
        self._is_reading = False

    def resume_reading(self) -> None:
        self._is_reading = True
        self._become_due()

    def receive(self, room: memoryview) -> int:
        self._outside.pass_by("before it looks")
        return self._take(room)

    def write(self, data: bytes) -> None:
        self._heard(data)

    def close(self) -> None:
        self._loop.call_soon(self._user.connection_lost, None)

    abort = close

    def _become_due(self) -> None:
        if self._is_reading and self._unread and not self._is_due:
            self._is_due = True
            self._loop.call_soon(self._take_its_turn, self._dice.randrange(4))

    def _take_its_turn(self, others: int) -> None:
        """The loop has so many other things to do before it reads."""
        if others:
            self._loop.call_soon(self._take_its_turn, others - 1)
            return
        self._is_due = False
        if self._is_reading and (taken := self._take(self._user.get_buffer())):
            self._user.buffer_updated(taken)
        self._become_due()

    def _take(self, room: memoryview) -> int:
        taken = min(len(room), len(self._unread))
        if taken:
            room[:taken] = self._unread[:taken]
            del self._unread[:taken]
            self.read += taken
            self._outside.pass_by("when it has read")
            if self._outside.armed is not None:
                self._loop.call_soon(self._outside.pass_by, "in the turn after it has read")
        return taken
