"""What a serial line carries once framing is taken off, and what every serial framer can do."""

from typing import NamedTuple, Protocol

from gateway.modbus.pdu import RequestPdu


class Frame(NamedTuple):
    """A unit identifier and a PDU that arrived with a fitting CRC or LRC."""

    unit: int
    pdu: bytes

    def __repr__(self) -> str:
        return f"<Frame unit={self.unit} {self.pdu.hex(' ').upper()}>"


class ResponseFramer(Protocol):
    """Finds the response to the request that is on the line."""

    #: Whether something that is no frame has been received since `expect`.
    heard_noise: bool

    @property
    def is_clean(self) -> bool:
        """Whether nothing but frames that were handed over has been received since `expect`."""

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """The ADU as it goes on the line."""

    def expect(self, unit: int | None, asked: RequestPdu) -> None:
        """A request goes on the line: forget what was received, look for its response from `unit`, None from any."""

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that became readable at `now`; frames that are complete with them, in order.

        At least one of `damaged` ones is not what was sent: no frame has all of them in it.
        """

    @property
    def missing(self) -> int:
        """So many bytes must come before there can be a frame; 0 when nothing has begun, or that is not known."""

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None."""

    def tick(self, now: float) -> list[Frame]:
        """Let time pass; frames that silence has ended."""

    def conclude(self) -> list[Frame]:
        """No more is awaited in time: well-formed frames that were passed over. A late response may still complete."""


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
