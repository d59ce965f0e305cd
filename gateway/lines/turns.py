"""Gives out the turns at a line: the one policy for all requests that wait. `Turns.next` applies it.

- **Rounds.** In each round every waiting member has one turn, for one request: first the urgent ones, then the others
  in the order in which they came. After its turn a member has its next one in the next round. So has one that comes
  while a round is under way; but the first urgent one of these is still in this round. So no member comes first more
  than once in a round of the others, and none waits forever.
- **Addresses** take turns, and the connections of an address take turns in those of the address, in rounds of their
  own. So it makes no difference how many connections a host has.
- **Urgent** is a member that waits with a write, or for a device of high priority. Only its oldest request counts, so
  priority acts between clients.
- **With priority** waits a member whose oldest request is of a client for which a row of `[[access]]` says so. It goes
  before all others, urgent ones too, as soon as each that waited at its last turn has had one since. Between two that
  go first so, another has its turn. So of many that come and go the others still have half of the turns.
- **Held** is what must not be sent yet. It keeps its turn while others have theirs. The next round begins when only
  held ones of this one are left.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, Final

from gateway.compiler import mypyc_attr
from gateway.lines.transaction import Destination, Transaction
from gateway.request import Caller, Request

#: The round of a member's next turn: the one under way, or the next one. For a new member it is unknown.
UNKNOWN: Final = 0
NOW: Final = 1
LATER: Final = 2

#: What a member's oldest request is: plain, or one or both of the others.
PLAIN: Final = 0
URGENT: Final = 1
WITH_PRIORITY: Final = 2

#: Tells whether a transaction must not be sent yet.
Held = Callable[[Transaction], bool]


@mypyc_attr(free_list_len=1)
class Place:
    """The place of a waiting request in the row of its connection. The request waits while this is its `place`.

    `given_up` are the places of requests that their clients may no longer want. Its neighbours are linked: `before` and
    `after` it in the row, `earlier` and `later` in `Expiries`.
    """

    __slots__ = ("_given_up", "after", "before", "earlier", "expires_at", "later", "request", "row", "transaction")

    def __init__(
        self, request: Request, transaction: Transaction, row: "Row", expires_at: float, given_up: dict["Place", None]
    ) -> None:
        self.request = request
        self.transaction = transaction
        self.row = row
        self.expires_at = expires_at
        self.before: Place | None = None
        self.after: Place | None = None
        self.earlier: Place | None = None
        self.later: Place | None = None
        self._given_up = given_up

    def give_up(self) -> None:
        """Note that the client may no longer want the request."""
        self._given_up[self] = None


class Member(ABC):
    """One that takes turns, with `waiting` requests. `has_passed`: it had nothing to send in its last turn.

    `waited` are the names of those that waited at its last turn; None if it has never had priority.
    """

    __slots__ = ("after", "before", "has_passed", "name", "turn", "waited", "waiting")

    def __init__(self, name: str) -> None:
        self.name = name
        self.waiting = 0
        self.has_passed = False
        self.waited: set[str] | None = None
        #: The round of its next turn, and its neighbours in the line.
        self.turn = UNKNOWN
        self.before: Member | None = None
        self.after: Member | None = None

    @abstractmethod
    def rank(self) -> int:
        """Tell, of one that has waiting requests, whether it is URGENT, waits WITH_PRIORITY, or both; else PLAIN."""

    @abstractmethod
    def next(self, is_held: Held | None) -> Place | None:
        """Choose the request for its turn; None if all are held."""


class Row(Member):
    """The waiting requests of one connection, `oldest` to `newest`. It takes turns with the others of its `address`."""

    __slots__ = ("address", "newest", "oldest")

    def __init__(self, name: str, address: "Turns") -> None:
        super().__init__(name)
        self.address = address
        self.oldest: Place | None = None
        self.newest: Place | None = None

    def places(self) -> Iterator[Place]:
        """Iterate over the places of its requests."""
        place = self.oldest
        while place is not None:
            yield place
            place = place.after

    def rank(self) -> int:
        """Return what its oldest request is."""
        oldest = self.oldest
        if oldest is None:
            return PLAIN
        transaction = oldest.transaction
        rank = URGENT if transaction.device.is_urgent or not transaction.asked.only_reads else PLAIN
        return rank | WITH_PRIORITY if oldest.request.caller.has_priority else rank

    def next(self, is_held: Held | None) -> Place | None:
        """Choose the first request that may go: not held, and not after a held one whose order it keeps."""
        if is_held is None:
            return self.oldest  # the usual case
        held: list[Destination] = []
        for place in self.places():
            transaction = place.transaction
            must_wait = held and (transaction.device in held or transaction.is_broadcast)
            if not must_wait and not is_held(transaction):
                return place
            if transaction.is_broadcast:
                return None
            held.append(transaction.device)
        return None

    def holds_back(self, transaction: Transaction) -> bool:
        """Tell whether an earlier request goes before `transaction`, which waits here or is to be added."""
        for place in self.places():
            if place.transaction is transaction:
                return False
            if place.transaction.device is transaction.device or place.transaction.is_broadcast:
                return True
        return False

    def add(self, place: Place) -> None:
        """Add a request behind the others."""
        place.before = self.newest
        if place.before is None:
            self.oldest = place
        else:
            place.before.after = place
        self.newest = place
        self._count(1)
        if self.waiting == 1:
            self.address.sort(self)

    def add_first(self, place: Place) -> None:
        """Add a request before the others."""
        place.after = self.oldest
        if place.after is None:
            self.newest = place
        else:
            place.after.before = place
        self.oldest = place
        self._count(1)
        self.address.sort(self)

    def remove(self, place: Place) -> None:
        """Remove a request."""
        before, after = place.before, place.after
        if before is None:
            self.oldest = after
        else:
            before.after = after
        if after is None:
            self.newest = before
        else:
            after.before = before
        place.before = place.after = None
        self._count(-1)
        self.address.sort(self)

    def _count(self, more: int) -> None:
        self.waiting += more
        self.address.waiting += more
        if self.address.above is not None:
            self.address.above.waiting += more


class Turns(Member):
    """Members by name, and their rounds: addresses, or the connections of one address, which has its turns in `above`.

    They stand in a line: those with a turn in this round, then those with one in the next. After its turn a member goes
    to the end. The line is linked, because every request moves two members.
    """

    __slots__ = (
        "_first", "_has_let_in", "_last", "_prior", "_urgent", "_urgent_later", "_was_prior", "above", "members",
    )  # fmt: skip

    def __init__(self, name: str = "", above: "Turns | None" = None) -> None:
        super().__init__(name)
        self.above = above
        self.members: dict[str, Any] = {}
        self._first: Member | None = None
        self._last: Member | None = None
        #: Whether a member that came since the round began has a turn in it.
        self._has_let_in = False
        #: The urgent members, in this round and in the next one.
        self._urgent: dict[str, Member] = {}
        self._urgent_later: dict[str, Member] = {}
        #: The members that wait with priority, and whether one of these had the last turn, and went first.
        self._prior: dict[str, Member] = {}
        self._was_prior = False

    def rank(self) -> int:
        """Tell whether an urgent member has a turn in this round, and whether one waits with priority."""
        rank = URGENT if self._urgent else PLAIN
        return rank | WITH_PRIORITY if self._prior else rank

    def next(self, is_held: Held | None) -> Place | None:
        """Choose the next request, by the rules above. `is_held` is None if nothing is held."""
        if not self.waiting:
            return None
        place = self._next_prior(is_held) if self._prior else None
        if place is None:
            place = self._next_of_round(is_held)
        if place is None:  # only held ones are left of this round
            self._begin_round()
            place = self._next_of_round(is_held)
        return place

    def add(self, member: Member) -> None:
        """Add a new member at the end."""
        self.members[member.name] = member
        self._append(member)

    def sort(self, member: Member) -> None:
        """Update when a member has its turn: its oldest request may have changed."""
        member.has_passed = False
        rank = member.rank() if member.waiting else PLAIN
        if member.turn == UNKNOWN:
            self._let_in(member, rank)
        if rank or self._urgent or self._urgent_later or self._prior:
            self._sort_by(rank, member)
        first = self._first
        if self.waiting and first is not None and first.turn == LATER:
            self._begin_round()
        if self.above is not None:
            self.above.sort(self)

    def _sort_by(self, rank: int, member: Member) -> None:
        """Note that a member has this rank now."""
        if rank & URGENT:
            (self._urgent if member.turn == NOW else self._urgent_later)[member.name] = member
        else:
            self._urgent.pop(member.name, None)
            self._urgent_later.pop(member.name, None)
        if rank & WITH_PRIORITY:
            self._prior[member.name] = member
            member.waited = member.waited or set()
        else:
            self._prior.pop(member.name, None)

    def forget(self, member: Member) -> None:
        """Remove a member, unless requests of it wait."""
        if not member.waiting:
            self._remove(member)
            del self.members[member.name]
            if self.above is not None:
                self.above.forget(self)

    def _next_prior(self, is_held: Held | None) -> Place | None:
        """Choose the next request with priority; none if the last one was such a request."""
        if self._was_prior:
            return None
        for member in self._prior.values():
            place = member.next(is_held) if self._is_due(member) else None
            if place is not None:
                self._was_prior = True
                self._had_turn(member)
                return place
        return None

    def _is_due(self, member: Member) -> bool:
        """Tell whether each that waited at its last turn has had one since: it stands behind it then."""
        each = self._first if member.waited else None
        while each is not None and each is not member:
            if each.waiting and member.waited and each.name in member.waited:
                return False
            each = each.after
        return True

    def _next_of_round(self, is_held: Held | None) -> Place | None:
        """Choose the next request of this round: first the urgent ones."""
        self._was_prior = False
        if self._urgent:
            for member in self._urgent.values():
                place = member.next(is_held)
                if place is not None:
                    self._had_turn(member)
                    return place
        return self._next_in_order(is_held)

    def _next_in_order(self, is_held: Held | None) -> Place | None:
        """Choose the next request in order. A held member keeps its turn; one with nothing to send has had it."""
        each = self._first
        while each is not None and each.turn == NOW:
            after = each.after
            place = each.next(is_held) if each.waiting else None
            if place is not None or not each.waiting:
                self._had_turn(each)
            if place is not None:
                return place
            each = after
        return None

    def _let_in(self, member: Member, rank: int) -> None:
        """Give a new member its first turn: in the next round, or in this one."""
        member.turn = LATER
        if self.waiting > member.waiting and rank & URGENT and not self._has_let_in:
            self._has_let_in = True
            member.turn = NOW

    def _had_turn(self, member: Member) -> None:
        """Move a member to the end, for the next round.

        One with nothing to send is forgotten the second time: so one that asks again at once keeps its place.
        """
        if member.has_passed:
            self.forget(member)
            return
        member.has_passed = not member.waiting
        if self._urgent:
            self._urgent.pop(member.name, None)
        if member.waited is not None:
            self._prior.pop(member.name, None)
            others = self.members.items() if member.waiting else ()
            member.waited = {name for name, each in others if each.waiting}
        member.turn = LATER
        if member is not self._last:
            self._remove(member)
            self._append(member)

    def _begin_round(self) -> None:
        self._has_let_in = False
        each = self._first
        while each is not None:
            each.turn = NOW
            each = each.after
        if self._urgent_later:
            self._urgent.update(self._urgent_later)
            self._urgent_later.clear()

    def _append(self, member: Member) -> None:
        last = self._last
        member.before = last
        if last is None:
            self._first = member
        else:
            last.after = member
        self._last = member

    def _remove(self, member: Member) -> None:
        before, after = member.before, member.after
        if before is None:
            self._first = after
        else:
            before.after = after
        if after is None:
            self._last = before
        else:
            after.before = before
        member.before = member.after = None


class Clients(Turns):
    """The addresses of all clients, with the rows of their connections."""

    __slots__ = ()

    def row(self, caller: Caller) -> Row:
        """Return the row of a client. If it is new, the caller must add a request to it."""
        address: Turns | None = self.members.get(caller.share_key)
        if address is None:
            address = Turns(caller.share_key, self)
            self.add(address)
        row: Row | None = address.members.get(caller.client)
        if row is None:
            row = Row(caller.client, address)
            address.add(row)
        return row

    def rows(self) -> Iterator[Row]:
        """Iterate over all rows."""
        return (row for address in self.members.values() for row in address.members.values())

    def waiting_of(self, caller: Caller) -> tuple[int, int]:
        """Count the waiting requests of a client, and those of its address."""
        address: Turns | None = self.members.get(caller.share_key)
        if address is None:
            return 0, 0
        row: Row | None = address.members.get(caller.client)
        return 0 if row is None else row.waiting, address.waiting
