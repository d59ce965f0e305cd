"""What was measured on a line: how long requests took, and what the line's time went into. All in seconds."""

from dataclasses import dataclass
from math import inf
from typing import Final

from gateway.timing.characters import LineTiming
from gateway.timing.histogram import SECONDS, SHARES, Histogram

#: When an answer came while none has.
NEVER: Final = -inf


class Times:
    """How long the requests of one function to one unit took.

    `wait` is from a request's arrival until it was sent, `answer` from its last character until the last one of a valid
    response, and `share` that time's share of the limit. `request` is from a request's arrival until its client was
    answered, for all that were sent. `limit` is the last transaction's, `answered_at` when the last valid answer came.
    """

    __slots__ = ("answer", "answered_at", "limit", "request", "share", "wait")

    def __init__(self) -> None:
        self.wait = Histogram(SECONDS)
        self.answer = Histogram(SECONDS)
        self.share = Histogram(SHARES)
        self.request = Histogram(SECONDS)
        self.limit = 0.0
        self.answered_at = NEVER

    def answered(self, now: float, ends_at: float, limit: float) -> None:
        """A valid answer has come `now` to a request whose last character left at `ends_at`."""
        self.limit = limit
        self.answered_at = now
        self.answer.add(now - ends_at)
        self.share.add((now - ends_at) / limit if limit > 0.0 else 0.0)


@dataclass(frozen=True, slots=True)
class Phases:
    """What a line's time went into: requests, waiting for responses, responses, and the silences behind all that."""

    request: float
    wait: float
    response: float
    gap: float

    @property
    def busy(self) -> float:
        """All of it together: the time in which nothing else could be sent."""
        return self.request + self.wait + self.response + self.gap


class TimeSpent:
    """Adds up what a line's time goes into. Plain numbers: some of it is done for every transaction."""

    __slots__ = ("_around", "_byte", "gap", "request", "response", "wait")

    def __init__(self) -> None:
        self.request = 0.0
        self.wait = 0.0
        self.response = 0.0
        self.gap = 0.0
        self._around = 0.0
        self._byte = 0.0

    def tune(self, timing: LineTiming) -> None:
        """Responses take their time on a line like this."""
        self._around = timing.frame(0)
        self._byte = timing.frame(1) - timing.frame(0)

    def add(self, sent_at: float, ends_at: float, now: float, response: int, quiet_at: float) -> None:
        """A transaction was sent, its last character left at `ends_at`, and it is over `now`.

        The PDU of its response has so many bytes, 0 without one, and the next request may leave at `quiet_at`.
        """
        ends_at = min(ends_at, now)  # a port without a wire carries bytes at once
        spoken = self._around + self._byte * response if response else 0.0
        spoken = min(spoken, now - ends_at)
        self.request += ends_at - sent_at
        self.wait += now - ends_at - spoken
        self.response += spoken
        if quiet_at > now:
            self.gap += quiet_at - now

    def phases(self, asking: float = 0.0, waiting: float = 0.0) -> Phases:
        """All of it so far, and what a transaction that is not over has taken."""
        return Phases(self.request + asking, self.wait + waiting, self.response, self.gap)
