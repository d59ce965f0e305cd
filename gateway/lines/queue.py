"""The requests that wait for a line: in turns by client, urgent ones first, equal reads only once.

- **Turns.** Each client has a row of waiting transactions, and the rows take turns. UDP clients of one address share a
  row: a host has as many ports as it likes.
- **Priority.** Writes and devices of high priority go first. Only the first one in a row counts, so priority acts
  between clients. After `OVERTAKES` urgent transactions in a row a plain one goes. A mirror's polls go last, but one of
  each mirror after about `YIELDS` others, so that values do not become stale on a busy line.
- **Order.** A client's requests to one device keep their order; its broadcasts keep theirs to all its requests. A
  transaction that must not be sent yet lets others pass, except those.
- **Full queue.** The connection with most waiting requests loses its newest one; among equals, the one whose address
  has most. So a client with one request at a time is not shut out.
- **Equal reads** share one transaction while it waits, unless anything but reads has come since. It waits in the row of
  each of its clients and goes in the first turn of any. A read on the line is not shared: every response is newer than
  its request.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterator
from itertools import takewhile
from math import inf
from typing import Final

from gateway.lines.transaction import Destination, Transaction
from gateway.request import Origin, Request

#: How many urgent transactions may go before a plain one that waits.
OVERTAKES: Final = 4
#: How many others may go while a mirror waits for its poll.
YIELDS: Final = 16

#: Up to this many clients, empty rows are kept for the next request.
_EMPTY_ROWS: Final = 256

#: Whether a transaction must not be sent yet.
Held = Callable[[Transaction], bool]


class _Row:
    """The waiting transactions of those with this name, oldest first. An empty row does not take turns."""

    __slots__ = ("address", "name", "ring", "waiting")

    def __init__(self, origin: Origin) -> None:
        self.name = origin.row
        self.address = _address(origin)
        self.waiting: deque[Transaction] = deque()
        #: Where the row takes its turns.
        self.ring: deque[_Row]

    def next(self, is_held: Held | None) -> Transaction | None:
        """The first one that may go: not held, and not after a held one whose order it keeps."""
        if is_held is None:
            return self.waiting[0]  # as nearly always
        held: list[Destination] = []
        for transaction in self.waiting:
            must_wait = held and (transaction.device in held or transaction.is_broadcast)
            if not must_wait and not is_held(transaction):
                return transaction
            if transaction.is_broadcast:
                return None
            held.append(transaction.device)
        return None

    def holds_back(self, transaction: Transaction) -> bool:
        """Whether an earlier one here goes before `transaction`, which waits here or is to be added."""
        before = takewhile(lambda each: each is not transaction, self.waiting)
        return any(older.device is transaction.device or older.is_broadcast for older in before)

    def replace(self, old: Transaction, new: Transaction) -> None:
        """Put `new` in the place of `old`."""
        self.waiting[self.waiting.index(old)] = new


class WaitingQueue:
    """At most `size` requests wait, each for at most `max_wait` seconds. With `coalesce`, equal reads are shared."""

    def __init__(self, size: int, max_wait: float, *, coalesce: bool) -> None:
        self._size = size
        self._max_wait = max_wait
        self._coalesce = coalesce
        self._overtakes = 0
        self._yields = 0
        self._rows: dict[str, _Row] = {}
        self._urgent: deque[_Row] = deque()
        self._plain: deque[_Row] = deque()
        self._polls: deque[_Row] = deque()
        #: Every waiting request with its transaction.
        self._waiting: dict[Request, Transaction] = {}
        #: When each request will have waited too long, oldest first; also of some that no longer wait.
        self._expiries: deque[tuple[float, Request]] = deque()
        #: Transactions that wait to be sent again.
        self._repeats: list[Transaction] = []
        #: The reads that others may join, by device and PDU.
        self._reads: dict[tuple[Destination, bytes], Transaction] = {}

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, transaction: Transaction, now: float) -> Transaction | None:
        """Let a transaction with one request wait. Returns the one that the full queue loses: this or another one."""
        lost = self._make_room(transaction) if len(self._waiting) >= self._size else None
        if lost is transaction:
            return lost
        request = transaction.requests[0]
        shared = self._join(transaction, request) if self._reads else None
        if shared is None:
            self._append(transaction, transaction.row, request.origin)
            if self._coalesce:
                self._offer(transaction)
        self._waiting[request] = shared or transaction
        self._expiries.append((now + self._max_wait, request))
        return lost

    def __iter__(self) -> Iterator[Transaction]:
        """Each transaction that waits, once."""
        return iter(dict.fromkeys(self._waiting.values()))

    def put_back(self, transaction: Transaction) -> None:
        """Let a transaction wait to be sent again, first in its clients' rows, until its `gives_up_at`."""
        requests = transaction.requests
        self._expiries = deque(each for each in self._expiries if each[1] not in requests)
        for request in requests:
            self._put_first(transaction, request.origin)
            self._waiting[request] = transaction
        self._repeats.append(transaction)

    def take(self, is_held: Held | None = None) -> Transaction | None:
        """Take out the next transaction; None if none may be sent now."""
        if not self._waiting:
            return None
        for ring in self._in_turn():
            for _ in range(len(ring)):
                row = ring[0]
                transaction = row.next(is_held)
                if transaction is not None:
                    self._overtakes = self._overtakes + 1 if ring is self._urgent else 0
                    self._yields = self._yields + 1 if self._polls and ring is not self._polls else 0
                    if len(transaction.requests) > 1:
                        transaction = self._part(transaction)
                    self._remove(transaction)
                    if len(ring) > 1 and ring[0] is row:
                        ring.rotate(-1)
                    return transaction
                ring.rotate(-1)
        return None

    def expired(self, now: float) -> list[tuple[Request, str]]:
        """Remove the requests that have waited too long at `now`; with the names of the devices that they are for."""
        late = []
        expiries, waiting = self._expiries, self._waiting
        while expiries:
            expiry, request = expiries[0]
            is_waiting = request in waiting
            if is_waiting and now < expiry:
                break
            expiries.popleft()
            if is_waiting:
                transaction = waiting[request]
                transaction.counts.expired += 1
                late.append((request, transaction.device.name))
                self._withdraw(request)
        return late

    def waits_since(self) -> float:
        """When the request came that waits longest, or earlier. What waits to be sent again came long ago."""
        return -inf if self._repeats else self._expiries[0][0] - self._max_wait

    def given_up(self, now: float) -> list[Transaction]:
        """Remove the transactions that it is too late to send again."""
        if not self._repeats:
            return []
        return self._too_late(now)

    @property
    def has_expiry(self) -> bool:
        """Whether a request waits that may expire, so that who waits behind it does not expire earlier."""
        return bool(self._expiries and self._waiting)

    def next_expiry(self) -> float | None:
        """When the next request will have waited too long, or earlier."""
        expiry = self._expiries[0][0] if self._expiries and self._waiting else None
        if not self._repeats:
            return expiry
        until = min(transaction.gives_up_at for transaction in self._repeats)
        return until if expiry is None else min(until, expiry)

    def drop(self, is_dropped: Held) -> list[Transaction]:
        """Remove the transactions of which `is_dropped` is true."""
        waiting = dict.fromkeys(transaction for row in self._rows.values() for transaction in row.waiting)
        dropped = [transaction for transaction in waiting if is_dropped(transaction)]
        for transaction in dropped:
            self._remove(transaction)
        return dropped

    def clear(self) -> list[Transaction]:
        """Remove all."""
        return self.drop(lambda _: True)

    def _too_late(self, now: float) -> list[Transaction]:
        """See `given_up`. On its own: in a function with a lambda, each call costs an object, used or not."""
        return self.drop(lambda waiting: waiting.retries > 0 and waiting.gives_up_at <= now)

    def _in_turn(self) -> tuple[deque[_Row], ...]:
        """Urgent rows first and polls last, unless the others have waited long enough."""
        if self._yields * len(self._polls) >= YIELDS:
            return self._polls, self._urgent, self._plain
        if self._overtakes >= OVERTAKES:
            return self._plain, self._urgent, self._polls
        return self._urgent, self._plain, self._polls

    def _append(self, transaction: Transaction, name: str, origin: Origin) -> None:
        """Let a transaction wait in the row of this name, which is that of `origin`."""
        row = self._rows.get(name)
        if row is None:
            row = self._rows[name] = _Row(origin)
        if not row.waiting:
            row.ring = self._ring_for(transaction)
            row.ring.append(row)
        row.waiting.append(transaction)

    def _put_first(self, transaction: Transaction, origin: Origin) -> None:
        """Let a transaction wait first in a client's row. The row has its turn last."""
        row = self._rows.setdefault(origin.row, _Row(origin))
        if row.waiting:
            row.ring.remove(row)
        row.waiting.appendleft(transaction)
        row.ring = self._ring_for(transaction)
        row.ring.append(row)

    def _ring_for(self, transaction: Transaction) -> deque[_Row]:
        if transaction.yields:
            return self._polls
        urgent = transaction.device.is_urgent or not transaction.asked.only_reads
        return self._urgent if urgent else self._plain

    def _offer(self, transaction: Transaction) -> None:
        """Let others join a read; after anything else, earlier reads are not shared any more."""
        if transaction.yields:
            return  # a client that joined it would wait as long
        if transaction.asked.only_reads:
            self._reads[transaction.device, transaction.asked.data] = transaction
        else:
            self._reads.clear()

    def _join(self, transaction: Transaction, request: Request) -> Transaction | None:
        """The waiting transaction that `request` shares, unless it could overtake its client's earlier requests."""
        shared = self._reads.get((transaction.device, transaction.asked.data))
        if shared is None:
            return None
        row = self._rows.get(request.origin.row)
        if row is not None and row.holds_back(transaction):
            return None
        shared.counts.coalesced += 1
        shared.requests.append(request)
        self._append(shared, transaction.row, request.origin)
        return shared

    def _part(self, transaction: Transaction) -> Transaction:
        """Take out of a shared transaction the requests that overtake nothing in their rows."""
        stay = [each for each in transaction.requests if self._rows[each.origin.row].holds_back(transaction)]
        if not stay:
            return transaction
        go = [each for each in transaction.requests if each not in stay]
        part = type(transaction)(go[0], transaction.asked, transaction.device)
        part.requests = go
        for request in go:
            self._rows[request.origin.row].replace(transaction, part)
            self._waiting[request] = part
        transaction.requests = stay
        transaction.row = stay[0].origin.row
        transaction.counts.coalesced -= 1
        return part

    def _remove(self, transaction: Transaction) -> None:
        """Remove a transaction."""
        requests = transaction.requests
        if len(requests) == 1:  # as nearly always, and then its row is known without a call
            self._leave_row(transaction.row, transaction)
            del self._waiting[requests[0]]
        else:
            for request in requests:
                self._leave_row(request.origin.row, transaction)
                del self._waiting[request]
        if self._reads:
            key = (transaction.device, transaction.asked.data)
            if self._reads.get(key) is transaction:
                del self._reads[key]
        if self._repeats and transaction in self._repeats:
            self._repeats.remove(transaction)

    def _leave_row(self, name: str, transaction: Transaction) -> None:
        """Take a transaction out of a client's row, which keeps its place if it stays in its ring."""
        row = self._rows[name]
        row.waiting.remove(transaction)
        ring = self._ring_for(row.waiting[0]) if row.waiting else None
        if ring is row.ring:
            return
        row.ring.remove(row)
        if ring is not None:
            row.ring = ring
            ring.append(row)
        elif len(self._rows) > _EMPTY_ROWS:
            del self._rows[name]

    def _withdraw(self, request: Request) -> None:
        """Remove a request, and its transaction if it has no other."""
        transaction = self._waiting[request]
        if len(transaction.requests) == 1:
            self._remove(transaction)
            return
        self._leave_row(request.origin.row, transaction)
        transaction.requests.remove(request)
        transaction.row = transaction.requests[0].origin.row
        del self._waiting[request]

    def _make_room(self, newcomer: Transaction) -> Transaction | None:
        """Fail unwanted requests. Returns the transaction that is lost if the queue is still full."""
        for request in [request for request in self._waiting if not request.origin.wants(request)]:
            transaction = self._waiting[request]
            transaction.counts.count_error(transaction.unwanted, 1)
            self._withdraw(request)
            request.fail(transaction.unwanted)
        self._expiries = deque(each for each in self._expiries if each[1] in self._waiting)
        if len(self._waiting) < self._size:
            return None
        row = self._greediest(newcomer.requests[0].origin)
        if row is None:
            return newcomer
        newest = row.waiting[-1]
        request = next(each for each in newest.requests if each.origin.row == row.name)
        self._withdraw(request)
        if request in newest.requests:
            return newest
        return type(newest)(request, newest.asked, newest.device)

    def _greediest(self, origin: Origin) -> _Row | None:
        """The row with most requests, by connection, then by address; None if it is that of `origin`, with its new one.

        Repeats are not lost: 06 means that nothing was sent.
        """
        rows = [row for ring in (self._urgent, self._plain, self._polls) for row in ring if not row.waiting[-1].retries]
        address = _address(origin)
        by_address = Counter({address: 1})
        for row in rows:
            by_address[row.address] += len(row.waiting)
        own = sum(len(row.waiting) for row in rows if row.name == origin.row)
        most, greediest = (own + 1, by_address[address]), None
        for row in rows:
            load = (len(row.waiting), by_address[row.address])
            if load > most and row.name != origin.row:
                most, greediest = load, row
        return greediest


def _address(origin: Origin) -> str:
    """What counts as its address; a client without one counts as its own."""
    return origin.address or origin.client
