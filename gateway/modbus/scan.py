"""Scanners of a client: they find the frames of all senders in the bytes of a line.

Each frame found is a token, with its place in the bytes of the line. `lines.attribution` decides which request it
answers.
"""

from collections.abc import Sequence
from typing import Final

from gateway.compiler import mypyc_attr
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu

#: The PDU of an exception response.
EXCEPTION_SIZE: Final = 2
#: Each unit identifier as the first byte of a frame.
_BYTES: Final = tuple(bytes((unit,)) for unit in range(256))
#: A place beyond all bytes.
NEVER: Final = 1 << 60


@mypyc_attr(free_list_len=1, acyclic=True)
class Token:
    """A frame with a correct checksum, at the places `start` to `end` of the line; its last byte was read `at`.

    A token that `is_damaged` contains a byte that differs from what was sent.
    """

    __slots__ = ("at", "end", "frame", "is_damaged", "start")

    def __init__(self, start: int, end: int, at: float, frame: Frame, *, is_damaged: bool = False) -> None:
        self.start = start
        self.end = end
        self.at = at
        self.frame = frame
        self.is_damaged = is_damaged


class Expected:
    """A response to `asked` from the unit `answers_from`, None for any. It begins at place `since` or later."""

    __slots__ = ("answers_from", "asked", "head", "since", "skipped")

    def __init__(self, answers_from: int | None, asked: RequestPdu, since: int = 0) -> None:
        known = b"" if answers_from is None else _BYTES[answers_from]
        self.answers_from = answers_from
        self.asked = asked
        self.since = since
        #: The beginning of a normal response, after this many unknown bytes.
        self.skipped = 1 - len(known)
        self.head = known + asked.response_head

    @property
    def exception_head(self) -> bytes:
        """The beginning of an exception response, after `skipped` bytes."""
        return self.head[: 1 - self.skipped] + bytes((self.asked.function | EXCEPTION_BIT,))

    def can_be_damaged(self, pdu_size: int, *, shared: bool) -> bool:
        """Tell whether a frame with a wrong checksum and a PDU of this size can be the response.

        On a `shared` line it must not be as long as the request: it may be one.
        """
        size = self.asked.response_size
        return pdu_size == EXCEPTION_SIZE or (pdu_size == size and not (shared and size == len(self.asked.data)))

    def head_of(self, pdu_size: int) -> bytes:
        """Return the beginning of a response with a PDU of this size."""
        return self.head if pdu_size == self.asked.response_size else self.exception_head


class Scanner:
    """Finds the frames on one line, in the order of their ends.

    `position` is the place of the next byte. `late` are late responses that may still come. `silence` ends a frame of
    unknown size, in seconds.
    """

    def __init__(self, silence: float = 0.0) -> None:
        self.position = 0
        self.late: Sequence[Expected] = ()
        self.silence = silence
        self._expected: Expected | None = None
        self._sent = b""
        #: Ranges, start and end, with at least one damaged byte each.
        self._damage: list[tuple[int, int]] = []

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the ADU of `pdu`."""
        raise NotImplementedError

    def expect(self, expected: Expected, sent: bytes, *, echoes: bool) -> None:
        """Expect this response to `sent`, which is being sent; with `echoes` it comes after a copy of `sent`."""
        self._expected, self._sent = expected, sent
        expected.since = NEVER if echoes else self.position

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> list[Token]:
        """Take bytes. Return the frames that are complete with them.

        At least one of `damaged` bytes differs from what was sent: a frame that contains all of them is damaged. The
        response begins after `early` bytes.
        """
        raise NotImplementedError

    def deadline(self, expected: Expected) -> float | None:  # noqa: ARG002 - silence ends nothing by default
        """Return when silence may end this response; None if it cannot."""
        return None

    def tick(self, now: float) -> list[Token]:  # noqa: ARG002 - silence ends nothing by default
        """Let time pass. Return the frames that silence has ended."""
        return []

    def end(self) -> tuple[Token, ...]:
        """End the request. Return the frames that may have been part of its response.

        The response may still come late, even if its echo was lost.
        """
        if self._expected is not None and self._expected.since == NEVER:
            self._expected.since = self.position
        self._expected = None
        return ()

    @property
    def missing(self) -> int:
        """The least number of bytes that the response still needs; 0 if it has not begun, or that is unknown."""
        raise NotImplementedError

    def is_damaged(self, data: bytes, expected: Expected, *, shared: bool) -> bool:
        """Tell whether `data` looks like this response with a wrong checksum; if `shared`, like no damaged request.

        It must begin like the response, normal or exception, and have its size.
        """
        raise NotImplementedError

    def has_begun(self, data: bytes, head: bytes) -> bool:
        """Tell whether `data` contains the first bytes of a frame."""
        raise NotImplementedError

    def ended_by_silence(self, units: set[int]) -> list[Frame]:  # noqa: ARG002 - silence ends nothing by default
        """Return frames of unknown size from `units` that end with the last byte, if silence follows."""
        return []

    def _has_damage(self, start: int, end: int) -> bool:
        """Tell whether a damaged range lies between these places."""
        return any(start <= begin and behind <= end for begin, behind in self._damage)

    def _came_early(self) -> None:
        """Note that everything received so far is too early to be the response."""
        if self._expected is not None and self._expected.since != NEVER:
            self._expected.since = self.position
