"""Where the registers and coils of a virtual unit come from, by their addresses."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from gateway.images.virtual.row import Freshness, Row
from gateway.images.virtual.settings import FreshBits, SourceAge, VirtualSettings
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span


@dataclass(frozen=True, slots=True)
class Own:
    """Registers or coils of the unit itself."""

    place: Span


#: What an address belongs to. What is no row is computed, or fetched, when it is read.
Piece = Row | FreshBits | SourceAge | Own


class Touched:
    """What a read of `span` touches; its response begins with `head`."""

    __slots__ = ("freshness", "head", "others", "rows", "span")

    def __init__(self, span: Span, head: bytes, pieces: Iterable[Piece]) -> None:
        self.span = span
        self.head = head
        pieces = tuple(pieces)
        self.rows = tuple(each for each in pieces if isinstance(each, Row))
        self.others = tuple(_within(each, span) for each in pieces if not isinstance(each, Row))
        self.freshness = Freshness(self.rows)

    @property
    def has_own(self) -> bool:
        """Whether it touches registers of the unit itself."""
        return any(isinstance(each, Own) for each in self.others)

    @property
    def is_own(self) -> bool:
        """Whether it touches registers of the unit itself only."""
        return not self.rows and all(isinstance(each, Own) for each in self.others)


class Layout:
    """All pieces of a unit. No address belongs to two of them."""

    def __init__(self, settings: VirtualSettings, rows: Iterable[Row]) -> None:
        own = (
            Own(Span(area, first, last - first + 1))
            for area, ranges in settings.own.areas.items()
            for first, last in ranges
        )
        pieces: list[Piece] = [*rows, *settings.fresh, *settings.ages, *own]
        pieces.sort(key=lambda piece: piece.place.start)
        self._pieces: dict[Area, list[Piece]] = {area: [] for area in Area}
        for piece in pieces:
            self._pieces[piece.place.area].append(piece)
        self._starts = {area: [each.place.start for each in here] for area, here in self._pieces.items()}

    def touched(self, span: Span) -> Iterator[Piece]:
        """Yield the pieces with an address in `span`, in the order of their addresses."""
        here = self._pieces[span.area]
        at = max(0, bisect_right(self._starts[span.area], span.start) - 1)
        while at < len(here) and here[at].place.start < span.end:
            if here[at].place.touches(span):
                yield here[at]
            at += 1


def _within(piece: FreshBits | SourceAge | Own, span: Span) -> FreshBits | SourceAge | Own:
    """Take the part of own registers that lies in `span`, for there can be many."""
    if not isinstance(piece, Own):
        return piece
    start = max(piece.place.start, span.start)
    return Own(Span(span.area, start, min(piece.place.end, span.end) - start))
