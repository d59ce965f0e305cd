"""The open exchanges of a line: every request, ours or another client's, of which a response may still come.

RTU and ASCII frames have no transaction identifier, so a response looks like the response to the next request of the
same shape, whoever asked. What may still come is kept here, and all decisions read it: whose a frame is
(`attribution`), what must not be sent (`forbid_until`), when a connection must be renewed (`must_renew`), what the next
line on the port has to know (`handed_on`).

| an exchange is | who asked      | from                              | until                                         |
|----------------|----------------|-----------------------------------|-----------------------------------------------|
| current        | we             | its request is sent               | its response, its limit                       |
| late           | we             | its limit has ended               | all it is owed has come, its late window ends |
| silent         | we             | the same, if nothing was received | a response to it or a later one, or a new     |
|                |                | on a connection                   | connection                                    |
| foreign        | another client | its request was heard             | its response, or none can come any more, at   |
|                |                |                                   | the latest after `FOREIGN_LASTS` seconds      |

A late exchange forbids requests with the same function to the same unit; other functions and units go on (ADR 5). A
silent one may be in a device server that stalls, or in the network, for as long as that takes: if its window ends,
nothing more is sent on this connection.
"""

from collections.abc import Callable, Collection, Iterable
from typing import Final

from gateway.lines.exchange import Exchange
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.scan import Token
from gateway.timing.budget import AnswerTime

#: A request that a late window forbids waits if the window ends within this many seconds. Otherwise it fails at once,
#: so that a client that polls one unit after the other is not blocked.
WORTH_WAITING: Final = 0.250
#: A foreign request occupies the line until its response, or for this long, in seconds: longer than most devices take,
#: shorter than most clients wait for one that is silent. (Measured: ADR 5.)
FOREIGN_OCCUPIES: Final = 0.1
#: If requests to more units are without a response, another client scans the line, which is not awaited.
FOREIGN_SCAN: Final = 16
#: So many foreign requests to one unit are told apart: of more, one stands for several with its function.
FOREIGN_PER_UNIT: Final = 16

#: Returns whether the other end of a connection has received all that was written to it.
HasArrived = Callable[[], bool]


class Ledger:
    """The exchanges of a line. Late windows last `seconds`; None: as long as the device's answer times say."""

    def __init__(self, seconds: float | None) -> None:
        #: The one on the line, or about to be sent again; and the last one of ours, which may be over.
        self.current: Exchange | None = None
        self.last: Exchange | None = None
        #: Ours that are late or silent, in the order in which they became that.
        self.late: list[Exchange] = []
        #: Other clients' requests without a response, by unit: there may be many, and a frame concerns few of them.
        self.heard: dict[int, list[Exchange]] = {}
        #: The latest foreign request that shows another client. That may be there until it `ends_at`.
        self.other_client: Exchange | None = None
        self._seconds = seconds
        self._has_arrived: HasArrived | None = None
        #: How long after a request of an earlier line its response may come, in seconds.
        self._patience = 0.0

    # --- times ---

    def length(self, limit: float, answer_time: AnswerTime) -> float:
        """Return how long after its limit a response may come: twice the limit, or the device's longest time."""
        return max(2 * limit, answer_time.slowest) if self._seconds is None else self._seconds

    def end_of(self, transaction: Transaction, now: float) -> float:
        """Return when the window of a transaction ends that fails at `now`; it begins at its limit at the earliest."""
        ends_at = max(now, transaction.fails_at) + self.length(transaction.limit, transaction.device.answer_time)
        return max(ends_at, transaction.ends_at + transaction.patience)

    def expire(self, now: float) -> None:
        """Close what has ended. What a connection may hold back stays until it is released."""
        for each in self.late:
            if each.ends_at <= now:
                each.owed = 0
        self._drop_closed()

    # --- our requests ---

    def take(self, transaction: Transaction) -> Exchange:
        """Make a request of ours the current one: it is about to be sent, perhaps once more."""
        transaction.unit = transaction.device.unit
        before = self.current
        owed = transaction.awaits_second if before is None else before.owed
        current = Exchange(transaction.unit, transaction.answers_from, transaction.asked, 0, transaction)
        current.owed = owed + (not transaction.is_broadcast)
        if before is not None:
            current.is_silent, current.had_arrived = before.is_silent, before.had_arrived
        self.current = current
        return current

    def begin(self, current: Exchange, position: int) -> None:
        """Note that it is sent at this place: its response comes there or later."""
        current.place = current.since = position
        current.asked_at = current.sender.ends_at
        current.is_awaited = current.sender.expects_answer
        self.last = current

    def end(self, now: float) -> bool:
        """End the request on the line. If responses are owed, its late window opens: returns whether it does."""
        current, self.current = self.current, None
        if current is None or not current.owed:
            return False
        current.ends_at = self.end_of(current.sender, now)
        self.late.append(current)
        return True

    def owed(self) -> list[Exchange]:
        """List those of ours whose responses may still come."""
        return [each for each in self.late if each.owed]

    def count_late(self, now: float) -> int:
        """Count the late windows."""
        self.expire(now)
        return len(self.owed())

    def forbid_until(self, transaction: Transaction, now: float) -> float | None:
        """Return when `transaction` may be sent, if a late response could be taken for its own; else None."""
        self.expire(now)
        return max((each.ends_at for each in self.late if each.forbids(transaction)), default=None)

    def next_end(self) -> float | None:
        """Return when the next late window ends."""
        return min((each.ends_at for each in self.owed()), default=None)

    def changes_until(self, units: Collection[int]) -> float:
        """Return until when a device with one of the `units` may still change its address, or an earlier time."""
        ends = [each.ends_at for each in self.owed() if each.answers_from is None and each.unit in units]
        current = self.current
        if current is not None and current.answers_from is None and current.unit in units:
            ends.append(self.end_of(current.sender, current.sender.fails_at))
        return max(ends, default=0.0)

    def heads_of_others(self, unit: int) -> list[bytes]:
        """List the first bytes of late responses from units other than `unit`."""
        others = [each for each in self.owed() if each.unit != unit]
        return [bytes((each.unit, each.asked.function | bit)) for each in others for bit in (0, EXCEPTION_BIT)]

    def take_late(self, token: Token) -> Exchange | None:
        """Find the oldest exchange that this is a late response to, which is owed one less then."""
        self.expire(token.at)
        for each in self.owed():
            if token.start >= each.since and not token.is_damaged and each.accepts(token.frame):
                each.owed -= 1
                self._drop_closed()
                return each
        return None

    def extend(self, token: Token, foreign: Exchange, patience: Callable[[AnswerTime], float]) -> None:
        """Extend the windows that this response to a `foreign` request fits: it may have been ours.

        A response to the foreign request may come for as long after that as `patience` tells of a device.
        """
        for each in self.owed():
            if each.accepts(token.frame):
                device = None if each.transaction is None else each.transaction.device
                lasts = self._patience if device is None else patience(device.answer_time)
                each.ends_at = max(each.ends_at, foreign.asked_at + lasts)

    # --- what a connection may hold back ---

    def connected(self, has_arrived: HasArrived | None) -> None:
        """Begin with a new port, which holds nothing back. `has_arrived` is None unless it is a connection."""
        self._has_arrived = has_arrived
        for each in self.late:
            each.is_silent = False
        self._drop_closed()

    def is_underway(self) -> bool:
        """Tell whether the other end of the connection has not received all that was written to it."""
        return self._has_arrived is not None and not self._has_arrived()

    def note_silence(self, exchange: Exchange) -> None:
        """Note that nothing was received since this request was sent."""
        if self._has_arrived is not None:
            exchange.is_silent = True
            exchange.had_arrived = self._has_arrived()

    def release(self, exchange: Exchange) -> None:
        """Note a response: a connection keeps its order, so all requests up to this one have left the server."""
        exchange.is_silent = False
        for each in self.late:
            each.is_silent = each.is_silent and each.asked_at > exchange.asked_at
        self._drop_closed()

    def renews_at(self) -> float | None:
        """Return when nothing more may be sent on this connection, unless a response comes; None: never."""
        return min((each.ends_at for each in self.late if each.is_silent), default=None)

    def must_renew(self, now: float) -> bool:
        """Tell whether nothing may be sent on this connection, because it may hold a request back."""
        return any(each.is_silent and each.ends_at <= now for each in self.late)

    def await_arrived(self, position: int, now: float) -> None:
        """Open the late windows again of requests that had not arrived when these began: only now their limits do."""
        for each in [each for each in self.late if each.is_silent and each.ends_at <= now and not each.had_arrived]:
            if each.transaction is not None and self._has_arrived is not None:
                self.late.remove(each)
                each.ends_at = self.end_of(each.transaction, now + each.transaction.limit)
                each.owed = 1
                each.since = position
                each.had_arrived = self._has_arrived()
                self.late.append(each)

    # --- other clients' requests ---

    def foreign(self, unit: int | None = None) -> list[Exchange]:
        """List other clients' requests without a response, to this unit or to all."""
        if unit is not None:
            return self.heard.get(unit, [])
        return [each for requests in self.heard.values() for each in requests]

    def occupied_until(self) -> float:
        """Return until when another client's exchange occupies the line: nothing of ours is sent into its response.

        Of a unit with several requests the oldest counts: one that has not answered does not occupy the line again.
        """
        if len(self.heard) > FOREIGN_SCAN:
            return 0.0
        return FOREIGN_OCCUPIES + max((requests[0].asked_at for requests in self.heard.values()), default=0.0)

    def hear(self, request: Exchange) -> None:
        """Keep another client's request. None is dropped: of too many to one unit, the oldest two are joined."""
        requests = self.heard.setdefault(request.unit, [])
        requests.append(request)
        if len(requests) > FOREIGN_PER_UNIT:
            self._join_oldest(requests)

    def answered(self, foreign: Exchange) -> None:
        """Note a response to another client's request."""
        foreign.owed -= 1
        if not foreign.owed:
            self.close(foreign)

    def close(self, foreign: Exchange) -> None:
        """Forget another client's request."""
        requests = self.heard[foreign.unit]
        requests.remove(foreign)
        if not requests:
            del self.heard[foreign.unit]

    def _join_oldest(self, requests: list[Exchange]) -> None:
        """Join the oldest two with the same function. If there are none, there is one request for each function."""
        of_function: dict[int, Exchange] = {}
        for each in requests:
            before = of_function.get(each.asked.function)
            if before is not None:
                each.join(before)
                self.close(before)
                return
            of_function[each.asked.function] = each

    # --- the next line on the port ---

    def handed_on(self, now: float, patience: float) -> list[Exchange]:
        """List what may still come, for the next line on the port. Foreign responses come within `patience` seconds.

        Another client that may be there is an exchange that is owed nothing.
        """
        self.expire(now)
        handed = [_handed(each, each.owed, each.ends_at) for each in self.owed()]
        handed += [_handed(each, each.owed, each.asked_at + patience) for each in self.foreign()]
        if self.other_client is not None:
            handed.append(_handed(self.other_client, 0, self.other_client.ends_at))
        return [each for each in handed if each.ends_at > now]

    def take_over(self, exchanges: Iterable[Exchange], patience: float) -> None:
        """Take over what an earlier line on the port has handed on. Any response comes within `patience` seconds."""
        self._patience = patience
        for each in exchanges:
            if each.owed:
                self.late.append(_handed(each, each.owed, each.ends_at))
            elif self.other_client is None or self.other_client.ends_at < each.ends_at:
                self.other_client = each

    def _drop_closed(self) -> None:
        if self.late:
            self.late = [each for each in self.late if each.owed or each.is_silent]


def _handed(exchange: Exchange, owed: int, ends_at: float) -> Exchange:
    """Make the exchange as another line gets it: by then it does not matter who asked."""
    handed = Exchange(exchange.unit, exchange.answers_from, exchange.asked, 0)
    handed.owed = owed
    handed.ends_at = ends_at
    return handed
