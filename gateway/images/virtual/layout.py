"""Where the registers and coils of a virtual unit come from, by their addresses."""

from collections.abc import Iterable
from dataclasses import dataclass

from gateway.images.places import Places
from gateway.images.virtual.row import Freshness, Row
from gateway.images.virtual.settings import FreshBits, SourceAge, VirtualSettings
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


def layout(settings: VirtualSettings, rows: Iterable[Row]) -> Places[Piece]:
    """Make the places of all pieces of a unit. No address belongs to two of them."""
    own = (
        Own(Span(area, first, last - first + 1))
        for area, ranges in settings.own.areas.items()
        for first, last in ranges
    )
    pieces: tuple[Piece, ...] = (*rows, *settings.fresh, *settings.ages, *own)
    return Places((piece.place, piece) for piece in pieces)


def _within(piece: FreshBits | SourceAge | Own, span: Span) -> FreshBits | SourceAge | Own:
    """Take the part of own registers that lies in `span`, for there can be many."""
    if not isinstance(piece, Own):
        return piece
    start = max(piece.place.start, span.start)
    return Own(Span(span.area, start, min(piece.place.end, span.end) - start))
