"""Writes that wait for a user to confirm them, and the results of confirmed ones. Bounded; time is an argument."""

import asyncio
import secrets
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.values.complaint import Complaint
from gateway.operator.values.steps import NewValues
from gateway.profiles.reading import Reading
from gateway.profiles.writing import Write

#: How long a question can be confirmed, and its result be seen, in seconds; and how many there are at a time.
PATIENCE: Final = 120.0
KEPT: Final = 900.0
MOST: Final = 64


@dataclass(frozen=True, slots=True)
class Result:
    """The unit's answer: an exception, or the values after the write, if they could be read.

    After some exceptions the unit `may_have_acted` all the same.
    """

    exception: Complaint | str | None
    elapsed_ms: float
    after: tuple[bytes | None, ...] = ()
    why_not_read: Complaint | str | None = None
    may_have_acted: bool = False


@dataclass(slots=True)
class Question:
    """A write of `new` values to confirm: the `wanted` readings, and the request. `owner` is the user's CSRF token.

    `target` is what answered for the unit then: a reload may replace it. The readings have the values `before`, or
    `why_no_old` says why not. It is sent at most once: `is_sent` is set before. `waiting` has a function for each
    browser that waits for the `result`; it returns whether the browser is still connected.
    """

    unit: UnitPicture
    target: object
    owner: str
    new: NewValues
    wanted: tuple[Reading, ...]
    write: Write
    why_no_old: Complaint | str | None
    asked_at: float
    is_sent: bool = False
    result: Result | None = None
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    waiting: list[Callable[[], bool]] = field(default_factory=list)

    def is_over(self, now: float) -> bool:
        """Return whether it can be neither confirmed nor seen any longer."""
        return now - self.asked_at > (KEPT if self.is_sent else PATIENCE)


class Questions:
    """The questions by their identifiers, which cannot be guessed."""

    def __init__(self) -> None:
        self._questions: OrderedDict[str, Question] = OrderedDict()

    def put(self, question: Question, now: float) -> str:
        """Keep a question, and return its identifier. The oldest one makes room."""
        for identifier in [each for each, old in self._questions.items() if old.is_over(now)]:
            del self._questions[identifier]
        if len(self._questions) >= MOST:
            self._questions.popitem(last=False)
        identifier = secrets.token_urlsafe(16)
        self._questions[identifier] = question
        return identifier

    def find(self, identifier: str, now: float) -> Question | None:
        """Find a question; None if it is over."""
        question = self._questions.get(identifier)
        return None if question is None or question.is_over(now) else question
