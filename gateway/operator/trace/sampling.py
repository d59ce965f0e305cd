"""Limits the records per second of a reader that needs to see what happens, but not all of it."""

from collections.abc import Sequence

from gateway.trace.records import Incident, Record, Sent


class Sample:
    """Passes `per_second` records, at most twice as many in any one second. `left_out` counts the others.

    All but ordinary transactions go first; of these, some are taken at even distances.
    """

    def __init__(self, per_second: int, now: float) -> None:
        self.left_out = 0
        self._per_second = per_second
        self._room = float(per_second)
        self._at = now

    def of(self, records: Sequence[Record], now: float) -> Sequence[Record]:
        """Return the records that pass now, in their order."""
        self._room = min(self._per_second, self._room + (now - self._at) * self._per_second)
        self._at = now
        room = int(self._room)
        if len(records) > room:
            self.left_out += len(records) - room
            records = _chosen(records, room)
        self._room -= len(records)
        return records

    def taken(self) -> int:
        """Return how many were left out since the last call."""
        left_out, self.left_out = self.left_out, 0
        return left_out


def _chosen(records: Sequence[Record], room: int) -> Sequence[Record]:
    first = [at for at, record in enumerate(records) if not _is_ordinary(record)]
    rest = [at for at, record in enumerate(records) if _is_ordinary(record)]
    places = _spread(first, room) + _spread(rest, room - min(room, len(first)))
    return [records[at] for at in sorted(places)]


def _is_ordinary(record: Record) -> bool:
    return isinstance(record, Sent) and not isinstance(record, Incident)


def _spread(places: list[int], most: int) -> list[int]:
    """Choose at most this many places, at even distances."""
    if len(places) <= most:
        return places
    return [places[at * len(places) // most] for at in range(most)]
