"""The requests that wait for a line: in turns, equal reads only once, each for a limited time.

- **Turns**: see `turns`. A mirror's polls come last, but one of each mirror after about `YIELDS` others, so that values
  do not become stale on a busy line.
- **Order.** A client's requests to one device keep their order; its broadcasts keep theirs to all its requests. A
  transaction that must not be sent yet lets others pass, except those.
- **Full queue.** The connection with most waiting requests loses its newest one; among equals, the one whose address
  has most. So a client with one request at a time is not shut out.
- **Equal reads** share one transaction while it waits, unless anything but reads has come since. It waits in the row of
  each of its clients and goes in the first turn of any. A read on the line is not shared: every response is newer than
  its request.
"""

from collections.abc import Callable, Iterable, Iterator
from heapq import heapify, heappop, heappush, heapreplace
from itertools import chain, count
from math import inf
from typing import Final, cast

from gateway.lines.bits import BitsWrite
from gateway.lines.expiries import Expiries
from gateway.lines.transaction import Destination, Transaction
from gateway.lines.turns import Clients, Held, Place, Row
from gateway.request import Request

#: The number of other requests that may go while a mirror waits for its poll.
YIELDS: Final = 16
#: The most entries per request that may wait, including those of rows that have become shorter.
_ENTRIES: Final = 4


class Crowd:
    """Finds the rows with the most waiting requests; of equals, those whose address has most. Nothing is searched.

    It is a heap that is built when a request is refused, and used until it has `most` entries. Until then a row that
    grows is added again. One that shrinks is not: an entry that is too high is corrected when it comes up.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._entries: list[tuple[int, int, int, Row]] = []
        self._numbers = count()

    def grown(self, row: Row) -> None:
        """Count one more request in a row."""
        if len(self._entries) >= self._most:
            self._entries.clear()
        if self._entries:
            heappush(self._entries, self._entry(row))

    def greediest(self, rows: Callable[[], Iterable[Row]]) -> Row | None:
        """Return the row that loses a request, of all `rows`. Repeats are not lost: 06 means that nothing was sent.

        To ask for the rows costs as much as there are, even as an iterator: compiled, it is made of a list.
        """
        entries = self._entries
        if not entries:
            entries.extend(map(self._entry, rows()))
            heapify(entries)
        while entries:
            row = entries[0][-1]
            if row.newest is None or row.newest.transaction.is_repeat:
                heappop(entries)
            elif entries[0][:2] != self._entry(row)[:2]:
                heapreplace(entries, self._entry(row))
            else:
                return row
        return None

    def _entry(self, row: Row) -> tuple[int, int, int, Row]:
        return -row.waiting, -row.address.waiting, next(self._numbers), row


class WaitingQueue:
    """At most `size` requests wait, each for at most `max_wait` seconds. With `coalesce`, equal reads are shared."""

    def __init__(self, size: int, max_wait: float, *, coalesce: bool) -> None:
        self._size = size
        self._max_wait = max_wait
        #: How much longer requests may wait at present.
        self._longer = 0.0
        self._coalesce = coalesce
        self._clients = Clients()
        self._polls = Clients()
        #: Number of other requests that went since a poll did, while one waits.
        self._yields = 0
        self._crowd = Crowd(_ENTRIES * size)
        #: The places of requests that may expire: not of repeats.
        self._expiries = Expiries()
        #: The places of requests that their clients may no longer want.
        self._given_up: dict[Place, None] = {}
        #: Transactions that wait to be sent again.
        self._repeats: list[Transaction] = []
        #: The reads that others may join, by device and PDU.
        self._reads: dict[tuple[Destination, bytes], Transaction] = {}

    def __len__(self) -> int:
        return self._clients.waiting + self._polls.waiting

    def __iter__(self) -> Iterator[Transaction]:
        """Yield each waiting transaction once."""
        return iter(dict.fromkeys(place.transaction for row in self._rows() for place in row.places()))

    def put(self, transaction: Transaction, now: float) -> Transaction | None:
        """Add a transaction with one request. Return the one that a full queue loses: this or another; else None."""
        lost = self._make_room(transaction) if len(self) >= self._size else None
        if lost is transaction:
            return lost
        request = transaction.requests[0]
        row = self._clients_of(transaction).row(request.caller)
        shared = self._join(transaction, row) if self._reads else None
        if shared is None and self._coalesce:
            self._offer(transaction)
        place = Place(request, shared or transaction, row, now + self._max_wait + self._longer, self._given_up)
        request.place = place
        row.add(place)
        self._crowd.grown(row)
        self._expiries.add(place)
        return lost

    def put_back(self, transaction: Transaction) -> None:
        """Add a transaction that is sent again, or follows, first in its clients' rows, until its `gives_up_at`."""
        clients = self._clients_of(transaction)
        for request in transaction.requests:
            row = clients.row(request.caller)
            request.place = Place(request, transaction, row, inf, self._given_up)
            row.add_first(request.place)
        self._repeats.append(transaction)

    def take_repeat(self) -> Transaction | None:
        """Remove and return a transaction that waits to be sent again; None if none does."""
        if not self._repeats:
            return None
        transaction = self._repeats[0]
        self._remove(transaction)
        return transaction

    def take_following(self) -> Transaction | None:
        """Remove and return the write that must follow its read at once; None if none does."""
        for transaction in self._repeats:
            if isinstance(transaction, BitsWrite):
                self._remove(transaction)
                return transaction
        return None

    def take(self, is_held: Held | None = None) -> Transaction | None:
        """Remove and return the next transaction; None if none may be sent now."""
        place = self._next(is_held)
        if place is None:
            return None
        transaction = place.transaction
        if len(transaction.requests) > 1:
            transaction = self._part(transaction)
        self._remove(transaction)
        return transaction

    def expired(self, now: float) -> tuple[tuple[Request, str], ...]:
        """Remove the requests that have waited too long at `now`. Return each with the name of its device."""
        first = self._expiries.first
        if first is None or now < first.expires_at:
            return ()
        late = []
        while (place := self._expiries.first) is not None and place.expires_at <= now:
            place.transaction.counts.expired += 1
            late.append((place.request, place.transaction.device.name))
            self._withdraw(place)
        return tuple(late)

    def expired_repeats(self, now: float) -> tuple[Transaction, ...]:
        """Remove and return the transactions that it is too late to send again."""
        if not self._repeats:
            return ()
        late = [transaction for transaction in self._repeats if transaction.gives_up_at <= now]
        for transaction in late:
            self._remove(transaction)
        return tuple(late)

    def waits_since(self) -> float:
        """Return when the oldest waiting request came, or an earlier time; minus infinity if there is a repeat."""
        first = self._expiries.first
        return -inf if first is None or self._repeats else first.request.received_at

    def wait_longer(self, seconds: float) -> None:
        """Let requests wait longer by this many seconds: those that wait, and those that come before `wait_as_ever`."""
        self._longer = seconds
        for place in self._expiries:
            place.expires_at = max(place.expires_at, place.request.received_at + self._max_wait + seconds)

    def wait_as_ever(self, now: float) -> None:
        """Let no request wait longer than one that comes `now`."""
        self._longer = 0.0
        for place in self._expiries:
            place.expires_at = min(place.expires_at, now + self._max_wait)

    @property
    def has_expiry(self) -> bool:
        """Whether a request waits that may expire; requests behind it do not expire earlier."""
        return self._expiries.first is not None

    def next_expiry(self) -> float | None:
        """Return when the next request will have waited too long; None if none will."""
        first = self._expiries.first
        expiry = None if first is None else first.expires_at
        if not self._repeats:
            return expiry
        until = min(transaction.gives_up_at for transaction in self._repeats)
        return until if expiry is None else min(until, expiry)

    def drop(self, is_dropped: Held) -> list[Transaction]:
        """Remove and return the transactions for which `is_dropped` is true."""
        dropped = [transaction for transaction in self if is_dropped(transaction)]
        for transaction in dropped:
            self._remove(transaction)
        return dropped

    def clear(self) -> list[Transaction]:
        """Remove and return all transactions."""
        return self.drop(lambda _: True)

    def _clients_of(self, transaction: Transaction) -> Clients:
        return self._polls if transaction.yields else self._clients

    def _rows(self) -> Iterator[Row]:
        return chain(self._clients.rows(), self._polls.rows())

    def _next(self, is_held: Held | None) -> Place | None:
        """Choose the next request: polls last, unless the others have had enough turns since one went."""
        clients, polls = self._clients, self._polls
        if not polls.waiting:
            self._yields = 0
            return clients.next(is_held)
        is_poll_due = self._yields * len(polls.members) >= YIELDS
        for turns in (polls, clients) if is_poll_due else (clients, polls):
            place = turns.next(is_held)
            if place is not None:
                self._yields = 0 if turns is polls else self._yields + 1
                return place
        return None

    def _offer(self, transaction: Transaction) -> None:
        """Offer a read for sharing; after anything else, earlier reads are not shared any more."""
        if transaction.yields:
            return  # a client that joined it would have to wait as long
        if transaction.asked.only_reads:
            self._reads[transaction.device, transaction.asked.data] = transaction
        else:
            self._reads.clear()

    def _join(self, transaction: Transaction, row: Row) -> Transaction | None:
        """Join the waiting transaction that this one equals, unless it could overtake earlier requests in its row."""
        shared = self._reads.get((transaction.device, transaction.asked.data))
        if shared is None or row.holds_back(transaction):
            return None
        shared.counts.coalesced += 1
        shared.requests += transaction.requests
        return shared

    def _part(self, transaction: Transaction) -> Transaction:
        """Split off the requests of a shared transaction that overtake nothing in their rows."""
        go: list[Request] = []
        stay: list[Request] = []
        for request in transaction.requests:
            (stay if _place_of(request).row.holds_back(transaction) else go).append(request)
        if not stay:
            return transaction
        part = transaction.part(go)
        for request in go:
            _place_of(request).transaction = part
        transaction.requests = stay
        transaction.counts.coalesced -= 1
        return part

    def _remove(self, transaction: Transaction) -> None:
        for request in transaction.requests:
            self._leave(_place_of(request))
        if self._reads:
            key = (transaction.device, transaction.asked.data)
            if self._reads.get(key) is transaction:
                del self._reads[key]
        if self._repeats and transaction in self._repeats:
            self._repeats.remove(transaction)

    def _withdraw(self, place: Place) -> None:
        """Remove a request, and its transaction if it has no other."""
        transaction = place.transaction
        if len(transaction.requests) == 1:
            self._remove(transaction)
        else:
            self._leave(place)
            transaction.requests.remove(place.request)
        place.row.address.forget(place.row)

    def _leave(self, place: Place) -> None:
        place.request.place = None
        place.row.remove(place)
        if place.expires_at != inf:
            self._expiries.remove(place)
        if self._given_up:
            self._given_up.pop(place, None)

    def _make_room(self, newcomer: Transaction) -> Transaction | None:
        """Fail requests that no client wants any more. Return the transaction that is lost if that is not enough."""
        while self._given_up:
            self._drop_unwanted(self._given_up.popitem()[0])
        if len(self) < self._size:
            return None
        row = self._crowd.greediest(self._rows)
        of_client, of_address = self._clients_of(newcomer).waiting_of(newcomer.requests[0].caller)
        newest = None if row is None else row.newest
        if row is None or newest is None or (row.waiting, row.address.waiting) <= (of_client + 1, of_address + 1):
            return newcomer
        transaction = newest.transaction
        self._withdraw(newest)
        return transaction if newest.request in transaction.requests else transaction.part([newest.request])

    def _drop_unwanted(self, place: Place) -> None:
        request, transaction = place.request, place.transaction
        if not request.origin.wants(request):
            error = transaction.unwanted
            transaction.counts.count_error(error, 1)
            self._withdraw(place)
            request.fail(error)


def _place_of(request: Request) -> Place:
    """Return the place of a waiting request."""
    return cast("Place", request.place)
