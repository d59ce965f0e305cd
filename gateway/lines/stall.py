"""Requests that a connection may hold back: in a device server that stalls, or in the network.

A device server may hold a request that timed out for as long as it likes. If an equal request follows, the unit answers
both, and the first response is taken for the second one. A connection keeps its order, so a response shows that all
earlier requests have left the server. If a late window ends without a response to its request or to a later one, the
line opens a new connection, on which no response of the old one can come (ADR 5).
"""

from collections.abc import Callable
from typing import NamedTuple

from gateway.lines.transaction import Transaction

#: Whether the other end of a connection has received all that was written to it.
HasArrived = Callable[[], bool]


class _Held(NamedTuple):
    """A request without a response and the end of its late window.

    `had_arrived`: the server had received it when that window began.
    """

    request: Transaction
    sent_at: float
    ends_at: float
    had_arrived: bool


class Stall:
    """The requests that one connection may hold back; none if `has_arrived` is None: the port is no connection."""

    __slots__ = ("_has_arrived", "_held", "ends_at")

    def __init__(self, has_arrived: HasArrived | None) -> None:
        self._has_arrived = has_arrived
        self._held: list[_Held] = []
        #: When the next late window of these requests ends; None without any.
        self.ends_at: float | None = None

    def add(self, request: Transaction, ends_at: float) -> None:
        """Nothing was received since `request` was sent, and its late window begins."""
        if self._has_arrived is not None:
            self._keep([*self._held, _Held(request, request.ends_at, ends_at, self._has_arrived())])

    def answered(self, request: Transaction) -> None:
        """A response came: the server has sent all requests up to that one."""
        if self._held:
            self._keep([held for held in self._held if held.sent_at > request.ends_at])

    def is_over(self, now: float) -> bool:
        """Whether a late window has ended, so that nothing may be sent on this connection."""
        return self.ends_at is not None and now >= self.ends_at

    def take_underway(self, now: float) -> list[Transaction]:
        """Remove requests whose late window has ended, but which the server had not received when it began."""
        underway = [held for held in self._held if now >= held.ends_at and not held.had_arrived]
        self._keep([held for held in self._held if held not in underway])
        return [held.request for held in underway]

    def _keep(self, held: list[_Held]) -> None:
        self._held = held
        self.ends_at = min((each.ends_at for each in held), default=None)
