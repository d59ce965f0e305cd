"""In which order, and how often, handshakes are gone on with: pure, with the time as an argument."""

from collections import OrderedDict, deque
from math import inf
from typing import Final, Generic, TypeVar

#: How much of the time steps of handshakes may take, and how many seconds of it are saved up while there are none.
SHARE: Final = 0.2
SAVED: Final = 0.05

AnyStream = TypeVar("AnyStream")


class Turns(Generic[AnyStream]):
    """Streams whose next step is due. Addresses take turns, and steps take at most SHARE of the time together.

    So a client waits for one step of each other address at most, however many handshakes they have.
    """

    def __init__(self) -> None:
        self._due: OrderedDict[str, deque[AnyStream]] = OrderedDict()
        self._credit = SAVED
        self._counted_at = -inf

    def add(self, stream: AnyStream, origin: str) -> None:
        """A step of this stream, from this address, is due."""
        self._due.setdefault(origin, deque()).append(stream)

    def drop(self, stream: AnyStream, origin: str) -> None:
        """No step of this stream is due any more, if one was."""
        streams = self._due.get(origin, deque())
        if stream in streams:
            streams.remove(stream)
            if not streams:
                del self._due[origin]

    def next(self) -> AnyStream | None:
        """The stream whose turn it is, which is taken out; None if no step is due."""
        if not self._due:
            return None
        origin, streams = self._due.popitem(last=False)
        stream = streams.popleft()
        if streams:
            self._due[origin] = streams  # behind all others
        return stream

    def took(self, seconds: float, now: float) -> None:
        """A step has taken this long."""
        self._count(now)
        self._credit -= seconds

    def pause(self, now: float) -> float:
        """In how many seconds the next step may begin; 0.0 if now."""
        self._count(now)
        return max(0.0, -self._credit / SHARE)

    def clear(self) -> None:
        """Nothing is due any more."""
        self._due.clear()

    def _count(self, now: float) -> None:
        self._credit = min(SAVED, self._credit + (now - self._counted_at) * SHARE)
        self._counted_at = now
