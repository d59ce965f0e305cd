"""What a scan of a line has found."""

from dataclasses import dataclass
from typing import Literal

Result = Literal["answers", "exception", "garbled"]


@dataclass(frozen=True, slots=True)
class Found:
    """A unit that was heard. `code` is that of an exception, `answers_from` its address if it was asked at address 0.

    It was heard at the rate `baud`. `answer_ms` is from the end of the question to the end of the answer, None if that
    was garbled. `profile` is the built-in profile that fits, empty if that cannot be told.
    """

    unit: int
    result: Result
    code: int | None = None
    answer_ms: float | None = None
    profile: str = ""
    answers_from: int | None = None
    baud: int = 0


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a scan is, at the rate `baud`. `left_s` is how many seconds the rest takes if it goes on like this."""

    asked: int
    of: int
    left_s: float
    found: tuple[int, ...]
    baud: int


@dataclass(frozen=True, slots=True)
class ScanStep:
    """An answer of `scan`: its `progress`, or at last the units that were `found`.

    `asked` is how many numbers are asked, `known` which others of those that were named are configured or in use.
    `is_answered`: the line has devices that answer.
    """

    progress: Progress | None = None
    found: tuple[Found, ...] | None = None
    asked: int = 0
    known: str = ""
    is_answered: bool = False
