"""How often the log may say the same: ten lines a second or fewer, and how many more there would have been."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

#: Subjects that are told apart at a time; what comes beyond is told apart by its event name only.
MOST_SUBJECTS: Final = 1000

#: What an event is about. Of a client its host counts: each connection has another port.
_KEY: Final = ("line", "unit", "listener", "client", "problem")


class Subject(NamedTuple):
    """What lines that say the same have in common: urgency, event name, and what the event is about."""

    level: int
    name: str
    key: tuple[tuple[str, object], ...] = ()


def subject_of(level: int, name: str, fields: Mapping[str, object]) -> Subject:
    """The subject of an event with these fields."""
    return Subject(
        level, name, tuple((field, _without_port(field, fields[field])) for field in _KEY if field in fields)
    )


def _without_port(part: str, value: object) -> object:
    return str(value).rpartition(":")[0] or value if part == "client" else value


@dataclass(slots=True)
class _Suppressed:
    due: float
    count: int = 0


@dataclass(slots=True)
class Limiter:
    """Lets through at most `lines` about one subject in any `seconds`, and counts the rest.

    Once `seconds` are over that began with a suppressed event, the count is due. The last line is kept for it.
    """

    lines: int = 10
    seconds: float = 1.0
    #: When the latest lines about a subject were written; the subject that rests longest is the first.
    _written: dict[Subject, deque[float]] = field(default_factory=dict)
    #: What is counted at the moment; what is due first is the first.
    _suppressed: dict[Subject, _Suppressed] = field(default_factory=dict)

    @property
    def next_due(self) -> float | None:
        """When the next count is due, if there is one."""
        return next((one.due for one in self._suppressed.values()), None)

    def admits(self, subject: Subject, now: float) -> bool:
        """Whether an event about `subject` may be written; if not, it is counted."""
        subject = self._told_apart(subject, now)
        suppressed = self._suppressed.get(subject)
        room = self.lines if suppressed is None else self.lines - 1
        if self._lines(subject, now) < room:
            self._note(subject, now)
            return True
        if suppressed is None:
            suppressed = self._suppressed[subject] = _Suppressed(now + self.seconds)
        suppressed.count += 1
        return False

    def due(self, now: float) -> Iterator[tuple[Subject, int]]:
        """The counts that are due: to be written, each as one line about its subject."""
        while self._suppressed:
            subject, suppressed = next(iter(self._suppressed.items()))
            if suppressed.due > now:
                return
            del self._suppressed[subject]
            self._note(subject, now)
            yield subject, suppressed.count

    def _lines(self, subject: Subject, now: float) -> int:
        """How many lines about `subject` still count."""
        times = self._written.get(subject, ())
        return sum(time > now - self.seconds for time in times)

    def _note(self, subject: Subject, now: float) -> None:
        times = self._written.pop(subject, None) or deque(maxlen=self.lines)
        times.append(now)
        self._written[subject] = times

    def _told_apart(self, subject: Subject, now: float) -> Subject:
        """The subject, or what it counts as when there are too many."""
        if subject in self._written or len(self._written) < MOST_SUBJECTS:
            return subject
        self._forget(now)
        return subject if len(self._written) < MOST_SUBJECTS else subject._replace(key=())

    def _forget(self, now: float) -> None:
        """Forget the subjects about which nothing was written for `seconds`: nothing hangs on them any more."""
        while self._written:
            subject, times = next(iter(self._written.items()))
            if times[-1] > now - self.seconds:
                return
            del self._written[subject]
