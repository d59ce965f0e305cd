"""The requests that wait, in the order in which they came, which is that in which they will have waited too long."""

from collections.abc import Iterator

from gateway.lines.turns import Place


class Expiries:
    """Their places, linked by `earlier` and `later`: each request is added and removed once."""

    __slots__ = ("_last", "first")

    def __init__(self) -> None:
        self.first: Place | None = None
        self._last: Place | None = None

    def __iter__(self) -> Iterator[Place]:
        place = self.first
        while place is not None:
            yield place
            place = place.later

    def add(self, place: Place) -> None:
        """Add the place of a request that has just come."""
        last = self._last
        place.earlier = last
        if last is None:
            self.first = place
        else:
            last.later = place
        self._last = place

    def remove(self, place: Place) -> None:
        """Remove a place that was added."""
        earlier, later = place.earlier, place.later
        if earlier is None:
            self.first = later
        else:
            earlier.later = later
        if later is None:
            self._last = earlier
        else:
            later.earlier = earlier
        place.earlier = place.later = None
