"""Results of `scan`."""

from dataclasses import dataclass
from typing import Literal

Result = Literal["answers", "exception", "garbled"]


@dataclass(frozen=True, slots=True)
class SunSpecModel:
    """A SunSpec model of a unit, and the address of its header among the holding registers."""

    model: int
    address: int


@dataclass(frozen=True, slots=True)
class Found:
    """A unit that responded. `code` is that of an exception, `answers_from` its address if it was asked at address 0.

    `baud` is the rate at which it responded. `answer_ms` is from the end of the request to the end of the response,
    None if that was garbled. `profile` is the one that fits, several with commas between them if they cannot be told
    apart, or empty. `models` are its SunSpec models.
    """

    unit: int
    result: Result
    code: int | None = None
    answer_ms: float | None = None
    profile: str = ""
    answers_from: int | None = None
    baud: int = 0
    models: tuple[SunSpecModel, ...] = ()


@dataclass(frozen=True, slots=True)
class Progress:
    """The progress of a scan at the rate `baud`: `asked` of `of` units; the rest takes about `left_s` seconds."""

    asked: int
    of: int
    left_s: float
    found: tuple[int, ...]
    baud: int


@dataclass(frozen=True, slots=True)
class ScanStep:
    """An answer of `scan`: its `progress`, or the units `found` as the last one.

    `asked` counts the unit numbers to ask. `known` are the other numbers that were named: they are configured or in
    use. `is_answered`: the line has devices that respond.
    """

    progress: Progress | None = None
    found: tuple[Found, ...] | None = None
    asked: int = 0
    known: str = ""
    is_answered: bool = False
