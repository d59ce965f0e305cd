"""Measurements on a line: how long requests took, and how the line's time was used. All in seconds."""

from dataclasses import dataclass
from math import inf
from typing import Final

from gateway.timing.characters import LineTiming
from gateway.timing.histogram import SECONDS, SHARES, Histogram
from gateway.timing.usage import Usage

#: `answered_at` before the first response.
NEVER: Final = -inf
#: For each function, at most this many different numbers of items are kept, and for each of them this many times.
MOST_SIZES: Final = 24
KEPT: Final = 32


class TimesOfSize:
    """Responses with the same number of items: how many there were, the last times, and the longest, in seconds."""

    __slots__ = ("_last", "count", "longest")

    def __init__(self) -> None:
        self.count = 0
        self.longest = 0.0
        #: The time of each response in the place of its number, in turn: a deque costs ten times as much.
        self._last: list[float] = []

    @property
    def times(self) -> list[float]:
        """The last times, the latest one at the end."""
        at = self.count % KEPT
        return self._last[at:] + self._last[:at]

    def add(self, seconds: float) -> None:
        """Add a response."""
        if self.count < KEPT:
            self._last.append(seconds)
        else:
            self._last[self.count % KEPT] = seconds
        self.count += 1
        self.longest = max(self.longest, seconds)


class Samples:
    """The last response times of a function: what a timing table can be found from.

    Times from the end of a request to the end of its normal response, by number of items.
    """

    __slots__ = ("rows",)

    def __init__(self) -> None:
        self.rows: dict[int, TimesOfSize] = {}

    def add(self, items: int, seconds: float) -> None:
        """Add a response. Beyond MOST_SIZES, new numbers of items are left out."""
        row = self.rows.get(items)
        if row is None:
            if len(self.rows) >= MOST_SIZES:
                return
            row = self.rows[items] = TimesOfSize()
        row.add(seconds)


class Times:
    """How long the requests of one function to one unit took.

    `wait` is from a request's arrival until it was sent, `answer` from its last character to the last one of a valid
    response, and `share` that time divided by the limit. `request` is from a request's arrival to its response, for all
    that were sent. `samples` are the last times of normal responses. `limit` is that of the last transaction,
    `answered_at` the time of the last valid response. `late` responses came after their limit, the slowest
    of them after `latest` seconds; `latest_limit` was the limit of its request.
    """

    __slots__ = (
        "answer", "answered_at", "late", "latest", "latest_limit", "limit", "request", "samples", "share", "wait"
    )  # fmt: skip

    def __init__(self) -> None:
        self.wait = Histogram(SECONDS)
        self.answer = Histogram(SECONDS)
        self.share = Histogram(SHARES)
        self.request = Histogram(SECONDS)
        self.samples = Samples()
        self.limit = 0.0
        self.late = 0
        self.latest = 0.0
        self.latest_limit = 0.0
        self.answered_at = NEVER

    def answered(self, now: float, ends_at: float, limit: float) -> None:
        """Add a valid response that came `now` to a request whose last character was sent at `ends_at`."""
        self.limit = limit
        self.answered_at = now
        self.answer.add(now - ends_at)
        self.share.add((now - ends_at) / limit if limit > 0.0 else 0.0)

    def came_late(self, elapsed: float, limit: float) -> bool:
        """Add a response that was dropped `elapsed` seconds after its request; True if that was after the limit."""
        if elapsed <= limit:
            return False
        self.late += 1
        if elapsed > self.latest:
            self.latest, self.latest_limit = elapsed, limit
        return True


@dataclass(frozen=True, slots=True)
class Phases:
    """How a line's time was used: requests, waiting for responses, responses, and the silences after them."""

    request: float
    wait: float
    response: float
    gap: float

    @property
    def busy(self) -> float:
        """The sum: the time in which nothing else could be sent."""
        return self.request + self.wait + self.response + self.gap


class TimeSpent:
    """Adds up how a line's time is used, and by whom. Plain numbers, because it is on the request path."""

    __slots__ = ("_around", "_byte", "gap", "request", "response", "usage", "wait")

    def __init__(self) -> None:
        self.request = 0.0
        self.wait = 0.0
        self.response = 0.0
        self.gap = 0.0
        self.usage = Usage()
        self._around = 0.0
        self._byte = 0.0

    def tune(self, timing: LineTiming) -> None:
        """Set the times of the line, for the duration of responses."""
        self._around = timing.frame(0)
        self._byte = timing.frame(1) - timing.frame(0)

    def add(self, sent_at: float, ends_at: float, now: float, response: int, quiet_at: float) -> None:
        """Add a transaction that is over `now`; its last character was sent at `ends_at`.

        `response` is the size of its response PDU, 0 without one. The next request may be sent at `quiet_at`.
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
        """Add up all of it so far, with the times of the transaction in progress."""
        return Phases(self.request + asking, self.wait + waiting, self.response, self.gap)
