"""What a serial line carries once framing is taken off, and what every serial framer can do."""

from typing import NamedTuple, Protocol


class Frame(NamedTuple):
    """A unit identifier and a PDU that arrived with a fitting CRC or LRC."""

    unit: int
    pdu: bytes

    def __repr__(self) -> str:
        return f"<Frame unit={self.unit} {self.pdu.hex(' ').upper()}>"


class RequestFramer(Protocol):
    """Finds the frames on a line on which somebody else asks."""

    #: Whether something that is no frame has been heard since this was last set to False.
    heard_noise: bool

    @property
    def behind(self) -> int:
        """Bytes since the last frame, of a frame that is not complete or of noise."""

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """The ADU as it goes on the line."""

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that became readable at `now`; frames that are complete with them, in order.

        At least one of `damaged` ones is not what was sent: no frame has all of them in it.
        """

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None."""

    def tick(self, now: float) -> list[Frame]:
        """Let time pass; frames that silence has ended."""
