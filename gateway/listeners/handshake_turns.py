"""Decides which handshake goes on next, and when; pure, with the time as an argument."""

from collections import OrderedDict, deque
from math import inf
from typing import Final, Generic, TypeVar

#: The share of the time that steps of handshakes may take, and the most seconds of it that can be saved up.
SHARE: Final = 0.2
SAVED: Final = 0.05

AnyStream = TypeVar("AnyStream")


class Turns(Generic[AnyStream]):
    """Streams whose next step is due. Addresses take turns, and steps take at most SHARE of the time together.

    So a client waits for one step of each other address at most, however many handshakes those have.
    """

    def __init__(self) -> None:
        #: The streams by address, in the order of their turns.
        self._due: OrderedDict[str, deque[AnyStream]] = OrderedDict()
        #: The seconds that steps may take at once; negative if the last one took more.
        self._credit = SAVED
        #: When the credit was last increased.
        self._counted_at = -inf

    def add(self, stream: AnyStream, origin: str) -> None:
        """Add a stream from this address whose next step is due."""
        self._due.setdefault(origin, deque()).append(stream)

    def drop(self, stream: AnyStream, origin: str) -> None:
        """Remove a stream, if a step of it is due."""
        streams = self._due.get(origin, deque())
        if stream in streams:
            streams.remove(stream)
            if not streams:
                del self._due[origin]

    def next(self) -> AnyStream | None:
        """Remove and return the stream whose turn it is; None if no step is due."""
        if not self._due:
            return None
        origin, streams = self._due.popitem(last=False)
        stream = streams.popleft()
        if streams:
            self._due[origin] = streams  # behind all others
        return stream

    def took(self, seconds: float, now: float) -> None:
        """Count the time of a step."""
        self._count(now)
        self._credit -= seconds

    def pause(self, now: float) -> float:
        """Return the seconds until the next step may begin; 0.0 if it may begin now."""
        self._count(now)
        return max(0.0, -self._credit / SHARE)

    def clear(self) -> None:
        """Remove all streams."""
        self._due.clear()

    def _count(self, now: float) -> None:
        self._credit = min(SAVED, self._credit + (now - self._counted_at) * SHARE)
        self._counted_at = now
