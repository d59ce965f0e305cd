"""Writes that wait for a user to confirm them, and what became of those that he has. Bounded; time is an argument."""

import asyncio
import secrets
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gateway.operator.answers.unit import UnitPicture
from gateway.operator.complaint import Complaint
from gateway.profiles.point import Reading

#: How long a question may be answered, and what became of it be seen, in seconds; and how many there are at a time.
PATIENCE: Final = 120.0
KEPT: Final = 900.0
MOST: Final = 64


@dataclass(frozen=True, slots=True)
class Result:
    """What the unit has answered: an exception, or what it has afterwards, if that could be read.

    After some exceptions it `may_have_acted` all the same.
    """

    exception: Complaint | str | None
    elapsed_ms: float
    after: tuple[bytes | None, ...] = ()
    why_not_read: Complaint | str | None = None
    may_have_acted: bool = False


@dataclass(slots=True)
class Question:
    """Whether to write what is `wanted`, with the request `pdu`. `owner` is the CSRF token of who is asked.

    `target` is what answered for the unit then: a reload may lead its number elsewhere.
    The readings have what was there `before`, or `why_no_old`. It is sent at most once: `is_sent` is set before.
    `waiting` has for each browser that waits for the `result` what tells whether it still does.
    """

    unit: UnitPicture
    target: object
    owner: str
    wanted: tuple[Reading, ...]
    pdu: bytes
    why_no_old: Complaint | str | None
    asked_at: float
    is_sent: bool = False
    result: Result | None = None
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    waiting: list[Callable[[], bool]] = field(default_factory=list)

    def is_over(self, now: float) -> bool:
        """Whether it can be neither answered nor seen any longer."""
        return now - self.asked_at > (KEPT if self.is_sent else PATIENCE)


class Questions:
    """The questions by their identifiers, which nobody can guess."""

    def __init__(self) -> None:
        self._questions: OrderedDict[str, Question] = OrderedDict()

    def put(self, question: Question, now: float) -> str:
        """Keep a question; its identifier. The oldest one makes room."""
        for identifier in [each for each, old in self._questions.items() if old.is_over(now)]:
            del self._questions[identifier]
        if len(self._questions) >= MOST:
            self._questions.popitem(last=False)
        identifier = secrets.token_urlsafe(16)
        self._questions[identifier] = question
        return identifier

    def find(self, identifier: str, now: float) -> Question | None:
        """The question, if there is still one."""
        question = self._questions.get(identifier)
        return None if question is None or question.is_over(now) else question
