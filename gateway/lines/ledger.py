"""The open exchanges of a line: every request, ours or another client's, whose response may still come.

RTU and ASCII frames have no transaction identifier, so a response looks like the response to the next request of the
same shape, from any client. All responses that may still come are recorded here, and all decisions use them: the owner
of a frame (`attribution`), requests that must not be sent (`forbid_until`), when a connection must be renewed
(`must_renew`), and what the next line on the port has to know (`handed_on`).

| an exchange is | sender         | from                              | until                                         |
|----------------|----------------|-----------------------------------|-----------------------------------------------|
| current        | we             | its request is sent               | its response, its limit                       |
| late           | we             | its limit has ended               | all it is owed has come, its late window ends |
| silent         | we             | the same, if nothing was received | as many responses as sendings, one to a later |
|                |                | on a connection                   | request, or a new connection                  |
| foreign        | another client | its request was heard             | its response, or none can come any more, at   |
|                |                |                                   | the latest after `FOREIGN_LASTS` seconds      |

A late exchange forbids requests with the same function to the same unit; other functions and units go on (ADR 5). A
silent one may be stuck in a device server or in the network for an unknown time: when its window ends, nothing more is
sent on this connection.
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
#: shorter than most clients wait for a silent one. (Measured: ADR 5.)
FOREIGN_OCCUPIES: Final = 0.1
#: With unanswered foreign requests to more units than this, another client is scanning; that does not occupy the line.
FOREIGN_SCAN: Final = 16
#: The most foreign requests to one unit that are told apart; beyond that, one stands for several with its function.
FOREIGN_PER_UNIT: Final = 16

#: Tells whether the other end of a connection has received all written bytes.
HasArrived = Callable[[], bool]


class Ledger:
    """The exchanges of a line. Late windows last `seconds`; None: as the device's answer times say."""

    def __init__(self, seconds: float | None) -> None:
        #: The exchange on the line, or about to be sent again; and our last one, which may be over.
        self.current: Exchange | None = None
        self.last: Exchange | None = None
        #: Our late or silent exchanges, in the order in which they became late.
        self.late: list[Exchange] = []
        #: Other clients' requests without a response, by unit: there may be many, and a frame concerns few of them.
        self.heard: dict[int, list[Exchange]] = {}
        #: The latest foreign request that proves another client, who may be there until it `ends_at`.
        self.other_client: Exchange | None = None
        self._seconds = seconds
        self._has_arrived: HasArrived | None = None
        #: How long the response to a request of an earlier line may take, in seconds.
        self._patience = 0.0

    # --- times ---

    def length(self, limit: float, answer_time: AnswerTime) -> float:
        """Return how long after its limit a response may come: by default twice that, or the device's longest time."""
        return max(2 * limit, answer_time.slowest) if self._seconds is None else self._seconds

    def end_of(self, transaction: Transaction, now: float) -> float:
        """Return the end of the late window of a transaction that fails at `now`; it starts at its limit or later."""
        ends_at = max(now, transaction.fails_at) + self.length(transaction.limit, transaction.device.answer_time)
        return max(ends_at, transaction.ends_at + transaction.patience)

    def expire(self, now: float) -> None:
        """Close late windows that have ended. Exchanges that a connection may hold back stay until their release."""
        for each in self.late:
            if each.ends_at <= now:
                each.owed = 0
        self._drop_closed()

    # --- our requests ---

    def take(self, transaction: Transaction) -> Exchange:
        """Make a request of ours the current exchange: it is about to be sent, perhaps again."""
        transaction.unit = transaction.device.unit
        before = self.current
        owed = transaction.awaits_second if before is None else before.owed
        current = Exchange(transaction.unit, transaction.answers_from, transaction.asked, 0, transaction)
        current.owed = owed + (not transaction.is_broadcast)
        if before is not None:
            current.held, current.had_arrived = before.held and before.held + 1, before.had_arrived
        self.current = current
        return current

    def begin(self, current: Exchange, position: int) -> None:
        """Note that the current exchange is sent at this place: its response comes there or later."""
        current.place = current.since = position
        current.asked_at = current.sender.ends_at
        current.is_awaited = current.sender.expects_answer
        self.last = current

    def end(self, now: float) -> bool:
        """End the request on the line. Return True if responses are owed: then its late window opens."""
        current, self.current = self.current, None
        if current is None or not current.owed:
            return False
        current.ends_at = self.end_of(current.sender, now)
        self.late.append(current)
        return True

    def owed(self) -> list[Exchange]:
        """Return our exchanges whose responses may still come."""
        return [each for each in self.late if each.owed]

    def count_late(self, now: float) -> int:
        """Count the open late windows."""
        self.expire(now)
        return len(self.owed())

    def forbid_until(self, transaction: Transaction, now: float) -> float | None:
        """Return until when a late response could be taken for that of `transaction`; None if none can."""
        self.expire(now)
        return max((each.ends_at for each in self.late if each.forbids(transaction)), default=None)

    def next_end(self) -> float | None:
        """Return when the next late window ends."""
        return min((each.ends_at for each in self.owed()), default=None)

    def all_over_at(self) -> float:
        """Return when all late windows have ended, and no other client is there any more, or a time in the past."""
        ends = [each.ends_at for each in self.late]
        if self.other_client is not None:
            ends.append(self.other_client.ends_at)
        return max(ends, default=0.0)

    def changes_until(self, units: Collection[int]) -> float:
        """Return until when a device with one of the `units` may still change its address, or a time in the past."""
        ends = [each.ends_at for each in self.owed() if each.answers_from is None and each.unit in units]
        current = self.current
        if current is not None and current.answers_from is None and current.unit in units:
            ends.append(self.end_of(current.sender, current.sender.fails_at))
        return max(ends, default=0.0)

    def heads_of_others(self, unit: int) -> list[bytes]:
        """Return the first bytes of late responses from units other than `unit`."""
        others = [each for each in self.owed() if each.unit != unit]
        return [bytes((each.unit, each.asked.function | bit)) for each in others for bit in (0, EXCEPTION_BIT)]

    def take_late(self, token: Token) -> Exchange | None:
        """Find the oldest exchange that this late response answers, and count it as received; None if there is none."""
        self.expire(token.at)
        for each in self.owed():
            if token.start >= each.since and not token.is_damaged and each.accepts(token.frame):
                each.owed -= 1
                self._drop_closed()
                return each
        return None

    def extend(self, token: Token, foreign: Exchange, patience: Callable[[AnswerTime], float]) -> None:
        """Extend the windows of our exchanges that this response to a `foreign` request fits: it may have been theirs.

        A response to the foreign request may take as long after it as `patience` returns for a device.
        """
        for each in self.owed():
            if each.accepts(token.frame):
                device = None if each.transaction is None else each.transaction.device
                lasts = self._patience if device is None else patience(device.answer_time)
                each.ends_at = max(each.ends_at, foreign.asked_at + lasts)

    # --- exchanges that a connection may hold back ---

    @property
    def is_connected(self) -> bool:
        """Whether the line is behind a network, which brings responses as a whole."""
        return self._has_arrived is not None

    def connected(self, has_arrived: HasArrived | None) -> None:
        """Start with a new port, which holds nothing back. `has_arrived` is None unless it is a connection."""
        self._has_arrived = has_arrived
        for each in self.late:
            each.held = 0
        self._drop_closed()

    def is_underway(self) -> bool:
        """Tell whether the other end of the connection has not yet received all written bytes."""
        return self._has_arrived is not None and not self._has_arrived()

    def note_silence(self, exchange: Exchange) -> None:
        """Note that nothing was received since this request was sent."""
        if self._has_arrived is not None:
            exchange.held = exchange.held or 1
            exchange.had_arrived = self._has_arrived()

    def release(self, exchange: Exchange) -> None:
        """Note a response: a connection keeps its order, so all requests before this one have left the server.

        A late response to a request that was sent twice may be to the first sending: the second may still be held back.
        """
        if exchange.held:
            exchange.held = 0 if exchange is self.current else exchange.held - 1
        for each in self.late:
            if each is not exchange and each.asked_at <= exchange.asked_at:
                each.held = 0
        self._drop_closed()

    def renews_at(self) -> float | None:
        """Return when nothing more may be sent on this connection, unless a response comes; None if never."""
        return min((each.ends_at for each in self.late if each.held), default=None)

    def must_renew(self, now: float) -> bool:
        """Tell whether nothing may be sent on this connection, because it may hold a request back."""
        return any(each.held and each.ends_at <= now for each in self.late)

    def await_arrived(self, position: int, now: float) -> None:
        """Reopen the late windows of requests that had not arrived when these began: their limits begin only now."""
        for each in [each for each in self.late if each.held and each.ends_at <= now and not each.had_arrived]:
            if each.transaction is not None and self._has_arrived is not None:
                self.late.remove(each)
                each.ends_at = self.end_of(each.transaction, now + each.transaction.limit)
                each.owed = each.held
                each.since = position
                each.had_arrived = self._has_arrived()
                self.late.append(each)

    # --- other clients' requests ---

    def foreign(self, unit: int | None = None) -> list[Exchange]:
        """Return other clients' requests without a response, to this unit or to all."""
        if unit is not None:
            return self.heard.get(unit, [])
        return [each for requests in self.heard.values() for each in requests]

    def occupied_until(self) -> float:
        """Return until when another client's exchange occupies the line: we must not send into its response.

        For a unit with several requests the oldest counts: if it was not answered, the unit does not occupy the line
        again.
        """
        if len(self.heard) > FOREIGN_SCAN:
            return 0.0
        return FOREIGN_OCCUPIES + max((requests[0].asked_at for requests in self.heard.values()), default=0.0)

    def hear(self, request: Exchange) -> None:
        """Record another client's request. None is dropped: with too many to one unit, the oldest two are joined."""
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
        """Join the oldest two with the same function. Without such a pair there is one request per function."""
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
        """Return the exchanges for the next line on the port. Foreign responses come within `patience` seconds.

        Another client that may be there is an exchange that is owed nothing.
        """
        self.expire(now)
        handed = [_handed(each, each.owed, each.ends_at) for each in self.owed()]
        handed += [_handed(each, each.owed, each.asked_at + patience) for each in self.foreign()]
        if self.other_client is not None:
            handed.append(_handed(self.other_client, 0, self.other_client.ends_at))
        return [each for each in handed if each.ends_at > now]

    def take_over(self, exchanges: Iterable[Exchange], patience: float) -> None:
        """Take over exchanges from an earlier line on the port. Any response comes within `patience` seconds."""
        self._patience = patience
        for each in exchanges:
            if each.owed:
                self.late.append(_handed(each, each.owed, each.ends_at))
            elif self.other_client is None or self.other_client.ends_at < each.ends_at:
                self.other_client = each

    def _drop_closed(self) -> None:
        if self.late:
            self.late = [each for each in self.late if each.owed or each.held]


def _handed(exchange: Exchange, owed: int, ends_at: float) -> Exchange:
    """Copy the exchange for another line, without its sender."""
    handed = Exchange(exchange.unit, exchange.answers_from, exchange.asked, 0)
    handed.owed = owed
    handed.ends_at = ends_at
    return handed
