"""Counters of the frames on a line that are not responses to its requests: they tell what may be wrong there."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class Belated:
    """Responses that came after the late window of their request, and the longest time from a request to one."""

    count: int = 0
    longest: float = 0.0


@dataclass(slots=True)
class Overheard:
    """Frames since the start.

    `copies` equal the line's own last request: an adapter echoes, or another client sends the same. `requests` are all
    others, so another client sent them. By unit, `second_responses` are those that followed a valid response to the
    same request, and `belated` those that came after its late window.
    """

    copies: int = 0
    requests: int = 0
    second_responses: dict[int, int] = field(default_factory=dict)
    belated: dict[int, Belated] = field(default_factory=dict)

    def count_second_response(self, unit: int) -> None:
        """A response of `unit` came once more."""
        self.second_responses[unit] = self.second_responses.get(unit, 0) + 1

    def count_belated(self, unit: int, seconds: float) -> None:
        """A response of `unit` came so long after its request."""
        belated = self.belated.setdefault(unit, Belated())
        belated.count += 1
        belated.longest = max(belated.longest, seconds)
