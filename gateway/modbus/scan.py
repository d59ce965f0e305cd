"""What a line delivers, cut into frames, for the one that asks on it: what a scanner is told, and what it finds.

A scanner sees every byte that comes from a line, once and in order, from every sender. What it finds are tokens:
frames, each with its place in all that the line has delivered. Whose a frame is, is decided in `lines.attribution`.
"""

from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu

#: The PDU of an exception response.
EXCEPTION_SIZE: Final = 2
#: Behind everything that will ever come.
NEVER: Final = 1 << 60


class Token:
    """A frame with a fitting check sum, from `start` to before `end`, counted in bytes of the line.

    `at` is when its last byte was read. One that `is_damaged` has a byte in it that is not what was sent.
    """

    __slots__ = ("at", "end", "frame", "is_damaged", "start")

    def __init__(self, start: int, end: int, at: float, frame: Frame, *, is_damaged: bool = False) -> None:
        self.start = start
        self.end = end
        self.at = at
        self.frame = frame
        self.is_damaged = is_damaged


class Expected:
    """An answer that may come: to `asked`, from `unit`, None from any. It begins at `since` or behind it."""

    __slots__ = ("asked", "head", "since", "skipped", "unit")

    def __init__(self, unit: int | None, asked: RequestPdu, since: int = 0) -> None:
        known = b"" if unit is None else bytes((unit,))
        self.unit = unit
        self.asked = asked
        self.since = since
        #: How the response begins; so many bytes of a frame before that are not known.
        self.skipped = 1 - len(known)
        self.head = known + asked.response_head

    @property
    def exception_head(self) -> bytes:
        """How an exception response begins."""
        return self.head[: 1 - self.skipped] + bytes((self.asked.function | EXCEPTION_BIT,))

    def can_be_damaged(self, pdu_size: int) -> bool:
        """Whether a frame with a PDU of so many bytes can be the response with a wrong check sum, and no request."""
        size = self.asked.response_size
        return size is not None and (pdu_size == EXCEPTION_SIZE or pdu_size == size != len(self.asked.data))

    def head_of(self, pdu_size: int) -> bytes:
        """How a response with a PDU of so many bytes begins."""
        return self.head if pdu_size == self.asked.response_size else self.exception_head


class Scanner:
    """Finds the frames in what one line delivers, in the order of their ends.

    `position` is how many bytes it has delivered. `late` are answers to older requests that may still come. `silence`
    is how long the line must be quiet, in seconds, before a frame of unknown size ends.
    """

    def __init__(self, silence: float = 0.0) -> None:
        self.position = 0
        self.late: list[Expected] = []
        self.silence = silence
        self._expected: Expected | None = None
        self._sent = b""
        #: Places of bytes of which at least one is not what was sent.
        self._damage: list[tuple[int, int]] = []

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """The ADU as it goes on the line."""
        raise NotImplementedError

    def expect(self, expected: Expected, sent: bytes, *, echoes: bool) -> None:
        """`sent` goes on the line, and `expected` is its answer; with `echoes` it comes behind the copy of `sent`."""
        self._expected, self._sent = expected, sent
        expected.since = NEVER if echoes else self.position

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> list[Token]:
        """Take bytes that became readable at `now`; what is complete with them.

        At least one of `damaged` ones is not what was sent: a frame that has all of them in it is damaged. The answer
        begins behind all that came `early`.
        """
        raise NotImplementedError

    def deadline(self, expected: Expected) -> float | None:  # noqa: ARG002 - where silence ends nothing
        """When silence will show more of this answer, or None."""
        return None

    def tick(self, now: float) -> list[Token]:  # noqa: ARG002 - where silence ends nothing
        """Let time pass; what silence has ended."""
        return []

    def end(self) -> list[Token]:
        """The answer is not awaited any more; what was found that may have been part of it.

        It may come late all the same, also where its echo was lost.
        """
        if self._expected is not None and self._expected.since == NEVER:
            self._expected.since = self.position
        self._expected = None
        return []

    @property
    def missing(self) -> int:
        """So many bytes must come before there can be the answer; 0 when nothing has begun, or that is not known."""
        raise NotImplementedError

    def is_damaged(self, data: bytes, expected: Expected) -> bool:
        """Whether `data` is, for all that can be seen, this answer with a wrong check sum.

        It has the right beginning and the right size, normal or exception, and neither can be those of a request that
        was damaged.
        """
        raise NotImplementedError

    def has_begun(self, data: bytes, head: bytes) -> bool:
        """Whether `data` holds the first bytes of a frame."""
        raise NotImplementedError

    def ended_by_silence(self, units: set[int]) -> list[Frame]:  # noqa: ARG002 - where silence ends nothing
        """Frames of unknown size from one of `units` that reach to the end of what has come, if nothing follows."""
        return []

    def _has_damage(self, start: int, end: int) -> bool:
        """Whether all of some damaged bytes stand between these places."""
        return any(start <= begin and behind <= end for begin, behind in self._damage)

    def _came_early(self) -> None:
        """The answer begins behind all that has come, or, where an echo is awaited, behind that."""
        if self._expected is not None and self._expected.since != NEVER:
            self._expected.since = self.position
