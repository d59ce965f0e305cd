"""What has a place among the addresses of a unit or a device, found without looking at all of it."""

from bisect import bisect_right
from collections.abc import Iterable
from itertools import accumulate
from typing import Generic, TypeVar

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span

T = TypeVar("T")


class Places(Generic[T]):
    """Each has one place or several; places may overlap."""

    __slots__ = ("_by_area",)

    def __init__(self, placed: Iterable[tuple[Span, T]]) -> None:
        by_area: dict[Area, list[tuple[Span, T]]] = {}
        for each in placed:
            by_area.setdefault(each[0].area, []).append(each)
        #: Sorted by the first addresses; and for each, the end of those up to it.
        self._by_area: dict[Area, tuple[list[tuple[Span, T]], list[int]]] = {}
        for area, here in by_area.items():
            here.sort(key=lambda each: each[0].start)
            self._by_area[area] = here, list(accumulate((place.end for place, _ in here), max))

    def touched(self, span: Span) -> list[T]:
        """Find what has an address in `span`, in the order of the first addresses."""
        found: list[T] = []
        if span.area in self._by_area:
            here, ends = self._by_area[span.area]
            for at in range(bisect_right(ends, span.start), len(here)):
                place, each = here[at]
                if place.start >= span.end:
                    break
                if place.end > span.start:
                    found.append(each)
        return found
