"""Limits log lines about the same subject: to ten a second or fewer, later one a minute; counts the others."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import count
from typing import Final, NamedTuple

#: Subjects that are distinguished at a time; further ones only by their event name.
MOST_SUBJECTS: Final = 1000

#: A subject without a pause of PAUSE continues. After STEADY it is logged only once in STEADY; both in seconds.
PAUSE: Final = 10.0
STEADY: Final = 60.0

#: The fields that make the subject of an event. Of a client only the host counts, because each connection has another
#: port. The unit of a client's event does not count, because it may name all units. The result of its writes does,
#: because one host may be many clients behind a router.
_KEY: Final = ("line", "unit", "listener", "client", "problem")
_KEY_OF_CLIENT: Final = ("line", "listener", "client", "result")


class Subject(NamedTuple):
    """What lines about the same thing have in common: level, event name and key fields."""

    level: int
    name: str
    key: tuple[tuple[str, object], ...] = ()


def subject_of(level: int, name: str, fields: Mapping[str, object]) -> Subject:
    """Make the subject of an event with these fields."""
    key = _KEY_OF_CLIENT if "client" in fields else _KEY
    return Subject(level, name, tuple((part, _without_port(part, fields[part])) for part in key if part in fields))


def _without_port(part: str, value: object) -> object:
    host, _, port = str(value).rpartition(":")
    return host if part == "client" and host and port.isdecimal() else value


@dataclass(slots=True)
class _History:
    """The history of a subject: when it began, when it last occurred, when lines were written."""

    since: float
    latest: float
    written: deque[float]

    def add(self, now: float) -> None:
        """Note that an event has occurred."""
        if now - self.latest > PAUSE:
            self.since = now
        self.latest = now


@dataclass(slots=True)
class Limiter:
    """Lets through at most `lines` about one subject in any `seconds`, and counts the rest.

    The count is due `seconds` after the first suppressed event. One line is reserved for it, unless `lines` is 1: then
    the count is an additional line. A subject that continues for `steady` seconds without a PAUSE is only counted from
    then on, and its count is due once in STEADY.
    """

    lines: int = 10
    seconds: float = 1.0
    steady: float = STEADY
    #: The subject that was quiet for longest is the first.
    _histories: dict[Subject, _History] = field(default_factory=dict)
    #: The present counts, and when they are due.
    _suppressed: dict[Subject, int] = field(default_factory=dict)
    _due: list[tuple[float, int, Subject]] = field(default_factory=list)
    _tickets: Iterator[int] = field(default_factory=count)

    @property
    def next_due(self) -> float | None:
        """The time at which the next count is due, if there is one."""
        return self._due[0][0] if self._due else None

    def admits(self, subject: Subject, now: float, events: int = 1) -> bool:
        """Tell whether a line about `subject` may be written; if not, count its `events`."""
        subject = self._distinguish(subject, now)
        history = self._histories.pop(subject, None) or _History(now, now, deque(maxlen=self.lines))
        self._histories[subject] = history
        history.add(now)
        is_steady = now - history.since >= self.steady
        room = self.lines - (self._keeps_a_line and subject in self._suppressed)
        if not is_steady and sum(time > now - self.seconds for time in history.written) < room:
            history.written.append(now)
            return True
        if subject not in self._suppressed:
            self._suppressed[subject] = 0
            heappush(self._due, (now + (STEADY if is_steady else self.seconds), next(self._tickets), subject))
        self._suppressed[subject] += events
        return False

    def due(self, now: float) -> Iterator[tuple[Subject, int]]:
        """Yield the counts that are due, each to be written as one line about its subject."""
        while self._due and self._due[0][0] <= now:
            _, _, subject = heappop(self._due)
            if self._keeps_a_line and subject in self._histories:
                self._histories[subject].written.append(now)
            yield subject, self._suppressed.pop(subject)

    @property
    def _keeps_a_line(self) -> bool:
        return self.lines > 1

    def _distinguish(self, subject: Subject, now: float) -> Subject:
        """Return the subject, without its key fields if there are too many."""
        if subject in self._histories or len(self._histories) < MOST_SUBJECTS:
            return subject
        self._forget(now)
        return subject if len(self._histories) < MOST_SUBJECTS else subject._replace(key=())

    def _forget(self, now: float) -> None:
        """Forget the subjects that were quiet for `seconds`: their lines no longer count."""
        while self._histories:
            subject, history = next(iter(self._histories.items()))
            if max([history.latest, *history.written]) > now - self.seconds:
                return
            del self._histories[subject]
