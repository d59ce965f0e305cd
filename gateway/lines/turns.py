"""Whose turn it is at a line: the one policy for all requests that wait. `Turns.next` is all of it.

- **Rounds.** In each round everyone who waits has one turn, for one request: first those who are urgent, then the
  others in the order in which they came. After its turn a member has its next one in the next round. So has one that
  comes while a round is under way; but the first urgent one of these is still in this round. So nobody comes first more
  than once in a round of the others, and nobody waits for ever.
- **Addresses** take turns, and the connections of an address take turns in those of the address, in rounds of their
  own. So it makes no difference how many connections a host has.
- **Urgent** is a member that waits with a write, or for a device of high priority. Only its oldest request counts, so
  priority acts between clients.
- **Held** is what must not be sent yet. It keeps its turn while others have theirs. The next round begins when only
  held ones of this one are left.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from itertools import takewhile
from typing import Any, Final

from gateway.lines.transaction import Destination, Transaction
from gateway.request import Caller, Request

#: When a member has its next turn: in the round that is under way, or in the next one. Of a new one it is not known.
UNKNOWN: Final = 0
NOW: Final = 1
LATER: Final = 2

#: Tells whether a transaction must not be sent yet.
Held = Callable[[Transaction], bool]


class Place:
    """The place of a waiting request in the row of its connection. It waits as long as this is its `place`.

    `given_up` are the places of requests that their clients may not want any more.
    """

    __slots__ = ("_given_up", "expires_at", "request", "row", "transaction")

    def __init__(
        self, request: Request, transaction: Transaction, row: "Row", expires_at: float, given_up: dict["Place", None]
    ) -> None:
        self.request = request
        self.transaction = transaction
        self.row = row
        self.expires_at = expires_at
        self._given_up = given_up

    def give_up(self) -> None:
        """See Request."""
        self._given_up[self] = None


class Member(ABC):
    """One that takes turns; `waiting` requests are there. `has_passed`: it had nothing to send in its last turn."""

    __slots__ = ("after", "before", "has_passed", "name", "turn", "waiting")

    def __init__(self, name: str) -> None:
        self.name = name
        self.waiting = 0
        self.has_passed = False
        #: When it has its next turn, and which others stand before and after it.
        self.turn = UNKNOWN
        self.before: Member | None = None
        self.after: Member | None = None

    @property
    @abstractmethod
    def is_urgent(self) -> bool:
        """Tell whether its turn comes before those of others."""

    @abstractmethod
    def next(self, is_held: Held | None) -> Place | None:
        """Choose what is sent in its turn; None if all is held."""


class Row(Member):
    """The waiting requests of one connection, oldest first. It takes turns with the others of its `address`."""

    __slots__ = ("address", "places")

    def __init__(self, name: str, address: "Turns") -> None:
        super().__init__(name)
        self.address = address
        self.places: deque[Place] = deque()

    @property
    def is_urgent(self) -> bool:
        """See Member."""
        if not self.places:
            return False
        oldest = self.places[0].transaction
        return oldest.device.is_urgent or not oldest.asked.only_reads

    def next(self, is_held: Held | None) -> Place | None:
        """Choose the first one that may go: not held, and not after a held one whose order it keeps."""
        if is_held is None:
            return self.places[0]  # as nearly always
        held: list[Destination] = []
        for place in self.places:
            transaction = place.transaction
            must_wait = held and (transaction.device in held or transaction.is_broadcast)
            if not must_wait and not is_held(transaction):
                return place
            if transaction.is_broadcast:
                return None
            held.append(transaction.device)
        return None

    def holds_back(self, transaction: Transaction) -> bool:
        """Tell whether an earlier one here goes before `transaction`, which waits here or is to be added."""
        before = takewhile(lambda each: each.transaction is not transaction, self.places)
        return any(each.transaction.device is transaction.device or each.transaction.is_broadcast for each in before)

    def add(self, place: Place) -> None:
        """Let a request wait behind the others."""
        self.places.append(place)
        self._count(1)
        if self.waiting == 1:
            self.address.sort(self)

    def add_first(self, place: Place) -> None:
        """Let a request wait before the others."""
        self.places.appendleft(place)
        self._count(1)
        self.address.sort(self)

    def remove(self, place: Place) -> None:
        """Take a request out."""
        self.places.remove(place)
        self._count(-1)
        self.address.sort(self)

    def _count(self, more: int) -> None:
        self.waiting += more
        self.address.waiting += more
        if self.address.above is not None:
            self.address.above.waiting += more


class Turns(Member):
    """Members by name, and their rounds: addresses, or the connections of one, which has its turns in those `above`.

    They stand in a line: those with a turn in this round, then those with one in the next. After its turn a member goes
    to the end. The line is linked, because every request moves two members.
    """

    __slots__ = ("_first", "_has_let_in", "_last", "_urgent", "_urgent_later", "above", "members")

    def __init__(self, name: str = "", above: "Turns | None" = None) -> None:
        super().__init__(name)
        self.above = above
        self.members: dict[str, Any] = {}
        self._first: Member | None = None
        self._last: Member | None = None
        #: Whether one that came since the round began has a turn in it.
        self._has_let_in = False
        #: The urgent ones, in this round and in the next one.
        self._urgent: dict[str, Member] = {}
        self._urgent_later: dict[str, Member] = {}

    @property
    def is_urgent(self) -> bool:
        """See Member."""
        return bool(self._urgent)

    def next(self, is_held: Held | None) -> Place | None:
        """Choose what is sent next, by the rules above. `is_held` is None if nothing is held."""
        if not self.waiting:
            return None
        place = self._next_urgent(is_held) or self._next_in_order(is_held)
        if place is None:  # only held ones are left of this round
            self._begin_round()
            place = self._next_urgent(is_held) or self._next_in_order(is_held)
        return place

    def add(self, member: Member) -> None:
        """Give a new member its place, the last one."""
        self.members[member.name] = member
        self._append(member)

    def sort(self, member: Member) -> None:
        """Find out again when a member has its turn: its oldest request may be another one now."""
        member.has_passed = False
        if member.turn == UNKNOWN:
            self._let_in(member)
        if member.is_urgent:
            (self._urgent if member.turn == NOW else self._urgent_later)[member.name] = member
        elif self._urgent or self._urgent_later:
            self._urgent.pop(member.name, None)
            self._urgent_later.pop(member.name, None)
        first = self._first
        if self.waiting and first is not None and first.turn == LATER:
            self._begin_round()
        if self.above is not None:
            self.above.sort(self)

    def forget(self, member: Member) -> None:
        """Forget a member, unless something of it waits."""
        if not member.waiting:
            self._remove(member)
            del self.members[member.name]
            if self.above is not None:
                self.above.forget(self)

    def _next_urgent(self, is_held: Held | None) -> Place | None:
        if self._urgent:
            for member in self._urgent.values():
                place = member.next(is_held)
                if place is not None:
                    self._had_turn(member)
                    return place
        return None

    def _next_in_order(self, is_held: Held | None) -> Place | None:
        """Choose of all in their order. One that is held keeps its turn; one that has nothing to send has had it."""
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

    def _let_in(self, member: Member) -> None:
        """Give a new member its first turn: in the next round, or in this one."""
        member.turn = LATER
        if self.waiting > member.waiting and member.is_urgent and not self._has_let_in:
            self._has_let_in = True
            member.turn = NOW

    def _had_turn(self, member: Member) -> None:
        """Move a member to the end, for the next round.

        One that had nothing to send is forgotten the second time: one that asks again at once keeps its place.
        """
        if member.has_passed:
            self.forget(member)
            return
        member.has_passed = not member.waiting
        if self._urgent:
            self._urgent.pop(member.name, None)
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
        """Find the row of a client, which may be new: then something is to be added to it."""
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
        """Return the rows of all."""
        return (row for address in self.members.values() for row in address.members.values())

    def waiting_of(self, caller: Caller) -> tuple[int, int]:
        """Count how many requests of a client wait, and how many from its address."""
        address: Turns | None = self.members.get(caller.share_key)
        if address is None:
            return 0, 0
        row: Row | None = address.members.get(caller.client)
        return 0 if row is None else row.waiting, address.waiting
