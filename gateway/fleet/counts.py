"""Counts of requests from other sites, and of undelivered messages."""

from dataclasses import dataclass

from gateway.timing.measured import NEVER


@dataclass(slots=True)
class OwnerCounts:
    """Requests from other sites. NATS should have stopped the `dropped` ones; the last came at `dropped_at`."""

    requests: int = 0
    responses: int = 0
    busy: int = 0
    expired: int = 0
    refused: int = 0
    dropped: int = 0
    dropped_at: float = NEVER


@dataclass(slots=True)
class LostMessages:
    """Undelivered messages of other sites: `unreadable`, or `overflowed` because a queue was full."""

    unreadable: int = 0
    overflowed: int = 0
