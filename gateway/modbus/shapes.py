"""How the size of a PDU is known: from its function alone, from its first bytes, or only by the silence behind it."""

from gateway.errors import IllegalDataValue, RequestError
from gateway.modbus.codes import MAX_PDU


class Shape:
    """A PDU of one of `sizes`, in bytes. Its first `told_by` bytes tell which, or that only silence ends it.

    They may end with a byte count, which begins `count_at` some place. `longest` is the largest size; 0 if only silence
    ends it. A PDU that does not fit breaks the `rule`.
    """

    def __init__(self, told_by: int, sizes: range, rule: str, *, longest: int, count_at: int = 0) -> None:
        self.told_by = told_by
        self.sizes = sizes
        self.rule = rule
        self.longest = longest
        self._count_at = count_at

    def size(self, head: bytes) -> int:
        """So many bytes must be there before more can be said; then, the size. 0: only silence ends it."""
        at, told_by = self._count_at, self.told_by
        if len(head) < told_by:
            return told_by
        if not at:
            return self.longest
        return told_by + (head[at] if at + 1 == told_by else head[at] << 8 | head[at + 1])

    def fits(self, pdu: bytes) -> bool:
        """Whether a whole PDU has this shape."""
        return len(pdu) in self.sizes and self.size(pdu) in (0, len(pdu))


class Identification(Shape):
    """The objects of a device: their number in byte 6, then of each its identifier, length and value (A 6.21)."""

    def size(self, head: bytes) -> int:
        """See Shape."""
        size = 7
        for _ in range(head[6] if len(head) > 6 else 0):
            size += 2
            if len(head) < size:
                break
            size += head[size - 1]
        return size


def fixed(size: int) -> Shape:
    """A PDU that always has the same size."""
    return Shape(1, range(size, size + 1), f"the length must be {size} bytes", longest=size)


def counted(at: int, counts: range = range(MAX_PDU), *, width: int = 1) -> Shape:
    """A PDU with a byte count `at` this place, one byte or two, which is one of `counts`."""
    head = at + width
    sizes = range(head + counts.start, min(head + counts.stop, MAX_PDU + 1), counts.step)
    rule = f"the byte count must be {counts.start} to {sizes[-1] - head}, and that of the bytes behind it"
    return Shape(head, sizes, rule, longest=sizes[-1], count_at=at)


def any_size(least: int) -> Shape:
    """A PDU of any size from `least` bytes on, which only silence ends."""
    return Shape(least, range(least, MAX_PDU + 1), f"the length must be {least} to {MAX_PDU} bytes", longest=0)


def need(fits: bool, pdu: bytes, rule: str, error: type[RequestError] = IllegalDataValue) -> None:  # noqa: FBT001
    """Raise `error`, whose message shows the rule and the bytes of `pdu`, unless it fits."""
    if not fits:
        raise error(f"function {pdu[0]:02d}: {rule}: {pdu.hex(' ').upper()}")
