"""What has become of requests from other sites, and of messages that were not delivered."""

from dataclasses import dataclass

from gateway.timing.measured import NEVER


@dataclass(slots=True)
class OwnerCounts:
    """Requests from other sites; `dropped` are those that NATS should not have let through, the last `dropped_at`."""

    requests: int = 0
    responses: int = 0
    busy: int = 0
    expired: int = 0
    refused: int = 0
    dropped: int = 0
    dropped_at: float = NEVER


@dataclass(slots=True)
class LostMessages:
    """Messages of other sites that were not delivered: `unreadable` ones, and those that `overflowed` a queue."""

    unreadable: int = 0
    overflowed: int = 0
