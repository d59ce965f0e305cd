"""Requests that a connection may hold back: in a device server that stalls, or in the network before it.

A request that timed out may stand in the server as long as the server likes. If an equal one follows it there, the unit
answers both, and its first answer is taken for the second. What comes on one connection is put on the line in that
order, so an answer shows that all that was asked before has left the server. When a late window ends, and nothing
was answered of what was asked since, a new connection is made: it owes nothing, as far as the server forgets what the
old one has left (ADR 5).
"""

from collections.abc import Callable
from typing import NamedTuple

from gateway.lines.transaction import Transaction

#: Whether all that was written to a connection has arrived at its other end.
HasArrived = Callable[[], bool]


class _Held(NamedTuple):
    """A request, sent at `sent_at`, that nobody has answered, and when its late window ends.

    `had_arrived` says that it was at the server when that window began.
    """

    question: Transaction
    sent_at: float
    ends_at: float
    had_arrived: bool


class Stall:
    """What one connection may hold back. Nothing is, where `has_arrived` is None: that port is no connection."""

    __slots__ = ("_has_arrived", "_held", "ends_at")

    def __init__(self, has_arrived: HasArrived | None) -> None:
        self._has_arrived = has_arrived
        self._held: list[_Held] = []
        #: When the next late window of these requests ends; None without any.
        self.ends_at: float | None = None

    def timed_out(self, question: Transaction, ends_at: float) -> None:
        """Nothing has come since `question` was sent, and its late window begins."""
        if self._has_arrived is not None:
            self._keep([*self._held, _Held(question, question.ends_at, ends_at, self._has_arrived())])

    def answered(self, question: Transaction) -> None:
        """There is an answer: the server has sent all requests up to that one."""
        if self._held:
            self._keep([held for held in self._held if held.sent_at > question.ends_at])

    def is_over(self, now: float) -> bool:
        """Whether a late window has ended, so that nothing may be sent on this connection."""
        return self.ends_at is not None and now >= self.ends_at

    def take_underway(self, now: float) -> list[Transaction]:
        """Remove those whose late window has ended, but which had not arrived at the server when it began."""
        underway = [held for held in self._held if now >= held.ends_at and not held.had_arrived]
        self._keep([held for held in self._held if held not in underway])
        return [held.question for held in underway]

    def _keep(self, held: list[_Held]) -> None:
        self._held = held
        self.ends_at = min((each.ends_at for each in held), default=None)
