"""The last records, as many as fit into this many bytes. A reader that follows looks here from time to time.

So a reader costs the lines nothing, however slow it is: what it has not fetched in time is gone, and it is told how
much that was (docs/adr/0017-trace.md).
"""

from collections import deque
from collections.abc import Iterator
from typing import Final

from gateway.errors import RequestError
from gateway.request import Request
from gateway.trace.records import RECORD, Answered, PortChanged, Record, Refused

#: Failures are kept for longer than all else, in this part of the ring.
FAILURES_SHARE: Final = 8
#: This many records are looked at in one go: some 0.1 ms.
STEP: Final = 256


class Ring:
    """Keeps this many bytes of records; 0: none at all.

    `added` is how many there ever were: the number of a record is how many there were before it. `first` is the number
    of the oldest that is kept.
    """

    def __init__(self, limit: int = 0) -> None:
        self.added = 0
        self.first = 0
        self._limit = 0
        self._size = 0
        #: A place for each record that may be kept; where the oldest stands, and where the next one goes.
        self._places: list[Record | None] = []
        self._oldest = 0
        self._next = 0
        self._failures: deque[Record] = deque()
        self._failures_size = 0
        self._failures_limit = 0
        self.resize(limit)

    @property
    def is_on(self) -> bool:
        """Whether it keeps anything."""
        return self._limit > 0

    def add(self, record: Record) -> None:
        """Keep a record, in place of the oldest ones if need be."""
        places = self._places
        self._size += record.size
        while self._size > self._limit and self.first < self.added:
            self._drop_oldest()
        at = self._next
        places[at] = record
        self._next = at + 1 if at + 1 < len(places) else 0
        self.added += 1

    def add_failure(self, record: Record) -> None:
        """Keep the record of a request without data for its client."""
        self.add(record)
        self._failures.append(record)
        self._failures_size += record.size
        self._trim_failures()

    def refuse(
        self,
        request: Request,
        error: RequestError,
        now: float,
        *,
        line: str = "",
        name: str = "",
        until: float = 0.0,
        count: int = 0,
    ) -> None:
        """Keep a request that is not sent to anybody; see `Refused`."""
        if self.is_on:
            client, received_at = request.caller.client, request.received_at
            self.add_failure(
                Refused(now, line, name, client, request.unit, request.pdu, error, received_at, until, count)
            )

    def answer(self, request: Request, response: bytes, now: float, name: str) -> None:
        """Keep a request that is answered here, from the image or mirror of this name."""
        if self.is_on:
            client, received_at = request.caller.client, request.received_at
            self.add(Answered(now, "", name, client, request.unit, request.pdu, response, received_at))

    def add_port(self, line: str, now: float, reason: str = "") -> None:
        """Keep that a port was lost for this reason; without one, that it was opened."""
        if self.is_on:
            self.add(PortChanged(now, line, reason))

    def resize(self, limit: int) -> None:
        """Keep this many bytes from now on, and of what is there as much as fits."""
        if limit == self._limit + self._failures_limit:
            return
        kept = self.after(self.first, self.added)
        self._failures_limit = limit // FAILURES_SHARE
        self._limit = limit - self._failures_limit
        self._places = [None] * (self._limit // RECORD + 1)
        self._oldest = self._next = self._size = 0
        self.added = self.first
        for record in kept:
            if self.is_on:
                self.add(record)
            else:
                self.added = self.first = self.added + 1
        self._trim_failures()

    def after(self, number: int, most: int = STEP) -> list[Record]:
        """Return the next records from this number on, at most this many. Some before may be gone: see `first`."""
        begin = max(number, self.first)
        return [self._record(each) for each in range(begin, min(self.added, begin + most))]

    def number_at(self, since: float) -> int:
        """Find the number of the first record that was made at `since` or later."""
        low, high = self.first, self.added
        while low < high:
            middle = (low + high) // 2
            if self._record(middle).at < since:
                low = middle + 1
            else:
                high = middle
        return low

    @property
    def begins_at(self) -> float | None:
        """When the oldest record was made; None without any."""
        return self._record(self.first).at if self.added > self.first else None

    def failures(self) -> Iterator[Record]:
        """Go through the failures, the newest first."""
        return reversed(self._failures)

    def _record(self, number: int) -> Record:
        record = self._places[(self._oldest + number - self.first) % len(self._places)]
        assert record is not None  # noqa: S101 - those from `first` to before `added` are there
        return record

    def _drop_oldest(self) -> None:
        at = self._oldest
        record = self._places[at]
        if record is not None:
            self._size -= record.size
        self._places[at] = None
        self._oldest = at + 1 if at + 1 < len(self._places) else 0
        self.first += 1

    def _trim_failures(self) -> None:
        while self._failures_size > self._failures_limit:
            self._failures_size -= self._failures.popleft().size
