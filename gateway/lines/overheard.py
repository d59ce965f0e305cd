"""Counters of the frames on a line that are not responses to its requests: they tell what may be wrong there."""

from dataclasses import dataclass, field

from gateway.timing.measured import NEVER


@dataclass(slots=True)
class Belated:
    """Responses that came after the late window of their request, and the longest time from a request to one.

    `limit` was that of the request.
    """

    count: int = 0
    longest: float = 0.0
    limit: float = 0.0


@dataclass(slots=True)
class Overheard:
    """Frames since the start.

    `copies` equal the line's own last request: an adapter echoes, or another client sends the same. `requests` are all
    others, so another client sent them. `copied_at` and `requested_at` are the times of the last ones; so many requests
    of the line were sent since then. By unit, `second_responses` are those that followed a valid response to the
    same request, and `belated` those that came after its late window.
    """

    copies: int = 0
    requests: int = 0
    copied_at: float = NEVER
    requested_at: float = NEVER
    sent_since_copy: int = 0
    sent_since_request: int = 0
    second_responses: dict[int, int] = field(default_factory=dict)
    belated: dict[int, Belated] = field(default_factory=dict)

    def count_sent(self) -> None:
        """The line sends a request."""
        self.sent_since_copy += 1
        self.sent_since_request += 1

    def count_copy(self, now: float) -> None:
        """A copy of the line's own request came."""
        self.copies += 1
        self.copied_at = now
        self.sent_since_copy = 0

    def count_request(self, now: float) -> None:
        """A request of another client was heard."""
        self.requests += 1
        self.requested_at = now
        self.sent_since_request = 0

    def count_second_response(self, unit: int) -> None:
        """A response of `unit` came once more."""
        self.second_responses[unit] = self.second_responses.get(unit, 0) + 1

    def count_belated(self, unit: int, seconds: float, limit: float) -> None:
        """A response of `unit` came this long after its request, which had this limit."""
        belated = self.belated.setdefault(unit, Belated())
        belated.count += 1
        if seconds > belated.longest:
            belated.longest, belated.limit = seconds, limit
