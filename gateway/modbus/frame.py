"""Frames on a serial line, and the common part of all framers of a server."""

from collections.abc import Iterator
from typing import Any

from gateway.compiler import mypyc_attr


@mypyc_attr(free_list_len=1, acyclic=True)
class Frame:
    """Unit identifier and PDU of a frame with a correct CRC or LRC; equal to the tuple of both.

    It is not a NamedTuple: creating one would call a function that is not compiled.
    """

    __slots__ = ("pdu", "unit")

    def __init__(self, unit: int, pdu: bytes) -> None:
        self.unit = unit
        self.pdu = pdu

    def __iter__(self) -> Iterator[Any]:
        return iter((self.unit, self.pdu))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Frame):
            return self.unit == other.unit and self.pdu == other.pdu
        return (self.unit, self.pdu) == other

    def __hash__(self) -> int:
        return hash((self.unit, self.pdu))

    def __repr__(self) -> str:
        return f"<Frame unit={self.unit} {self.pdu.hex(' ').upper()}>"


class RequestFramer:
    """Finds the frames on a line with another client.

    `heard_noise` is set when bytes were received that are not part of a frame, until the caller resets it.
    """

    def __init__(self) -> None:
        self.heard_noise = False
        self._skipped = 0

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the ADU of `pdu`."""
        raise NotImplementedError

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes. Return the frames that are complete with them, in order.

        At least one byte of `damaged` ones differs from what was sent: no frame contains all of them.
        """
        raise NotImplementedError

    def deadline(self) -> float | None:
        """Return when to call `tick`; None if there is no need to."""
        return None

    def tick(self, now: float) -> list[Frame]:  # noqa: ARG002 - silence ends nothing by default
        """Let time pass. Return the frames that silence has ended."""
        return []

    @property
    def unfinished(self) -> int:
        """Bytes of an incomplete frame."""
        raise NotImplementedError

    @property
    def behind(self) -> int:
        """Bytes since the last frame."""
        return self._skipped + self.unfinished

    def _skip(self, count: int) -> None:
        self._skipped += count
        self.heard_noise = self.heard_noise or count > 0
