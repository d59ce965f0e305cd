"""The last events: those from INFO on, bounded in number and bytes.

The first few about the same thing in an hour stand by themselves, further ones are counted in the last of these. If
there is too much all the same, the oldest event of the kind that takes most of the room goes: what happens seldom is
not displaced by what happens all the time.
"""

import json
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from operator import itemgetter
from threading import RLock
from typing import Any, Final, NamedTuple

from gateway.events import Event, Level
from gateway.observe.backlog import number_of

#: The most events that are kept, and the most bytes of their texts.
MOST_EVENTS: Final = 1000
MOST_BYTES: Final = 512 * 1024
#: So many about the same thing stand by themselves in so many seconds; then they are counted.
MOST_ALIKE: Final = 5
ALIKE_FOR: Final = 3600.0
#: So many different ones of one kind stand by themselves in so many seconds: clients can cause others in any number.
MOST_OF_A_KIND: Final = 100
OF_A_KIND_FOR: Final = 600.0
#: The most things that are told apart at a time.
_MOST_SUBJECTS: Final = 2000
#: How often a mere count is written to the file, in seconds.
COUNTS_EVERY: Final = 600.0
#: The longest text of a field, and the most names in it.
_LONGEST: Final = 400
_MOST_NAMES: Final = 20
#: The fields that make events about the same thing alike. Of a client only the host counts: each connection has another
#: port.
_KEY: Final = frozenset(
    {
        *("line", "unit", "device", "listener", "client", "user", "result", "address", "image", "addresses"),
        *("broker", "server", "lease", "topic", "file", "used_by", "key", "problem", "part", "socket"),
    }
)
#: What nobody looks for in a list.
_LEFT_OUT: Final = "traceback"


class LastEvent(NamedTuple):
    """An event that has happened so many `times`, at first and last `at` these times in seconds since 1970.

    `number` says which came first; `changed` counts all changes of all events. `text` says it in words.
    """

    number: int
    changed: int
    first_at: float
    last_at: float
    times: int
    name: str
    level: int
    text: str
    fields: Mapping[str, Any]
    begins: str = ""
    ends: tuple[str, ...] = ()
    size: int = 0

    def row(self) -> tuple[int, str]:
        """Make the row of a file."""
        told = self._asdict()
        del told["number"], told["changed"], told["size"]
        return self.number, json.dumps(told, separators=(",", ":"), default=str)


#: What stands in a row besides `ends`.
_TYPES: Final = {
    **dict.fromkeys(("first_at", "last_at"), int | float),
    **dict.fromkeys(("times", "level"), int),
    **dict.fromkeys(("name", "text", "begins"), str),
    "fields": dict,
}


def read_row(number: int, content: str) -> LastEvent:
    """Read what `row` has written.

    Raises:
        ValueError: it has not.
    """
    try:
        told = json.loads(content)
        event = LastEvent(number, 0, **{**told, "ends": tuple(told["ends"])}, size=len(content))
    except (LookupError, RecursionError, TypeError) as error:
        raise ValueError(str(error)) from error
    if not all(isinstance(getattr(event, name), kinds) for name, kinds in _TYPES.items()):
        raise ValueError("a value has another type")
    return event


class Changes(NamedTuple):
    """Events that a file does not have yet as they are, and the numbers of those that it has no longer to keep."""

    written: Sequence[LastEvent]
    gone: frozenset[int]


class _Subject:
    """Events about the same thing: since when they are counted, and how many stand by themselves; the last of these.

    `is_many`: it is all that cannot be told apart.
    """

    __slots__ = ("count", "is_many", "number", "since")

    def __init__(self, since: float, *, is_many: bool = False) -> None:
        self.since = since
        self.count = MOST_ALIKE - 1 if is_many else 0
        self.number = 0
        self.is_many = is_many


class LastEvents:
    """The last events of this gateway, also of earlier runs. Any thread may `add`.

    `clock` gives seconds since 1970. `changes`, `put_back`, `load` and `change_all` are for a file.
    """

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        # Reentrant: the garbage collector may cause an event meanwhile.
        self._lock = RLock()
        self._events: dict[int, LastEvent] = {}
        #: The numbers of each kind, the oldest first; and how much room they take.
        self._kinds: dict[str, deque[int]] = {}
        self._sizes: dict[str, int] = {}
        self._subjects: OrderedDict[tuple[object, ...], _Subject] = OrderedDict()
        self._recent: dict[str, _Subject] = {}
        self._number = 0
        self.changed = 0
        self._new: set[int] = set()
        self._counted: set[int] = set()
        self._gone: set[int] = set()
        self._counted_at = 0.0

    def add(self, event: Event) -> None:
        """Add an event, or count it."""
        if event.level < Level.INFO:
            return
        with self._lock:
            now = self._clock()
            subject = self._subject(event, now)
            alike = self._events.get(subject.number) if subject.count >= MOST_ALIKE else None
            if alike is not None:
                self._count(alike, now, number_of(event))
                return
            subject.count += 1
            subject.number = self._append(event, now, "others, such as: " if subject.is_many else "")
            self._bound()

    def all(self) -> list[LastEvent]:
        """Return all events, in the order of the times at which they happened last."""
        with self._lock:
            return sorted(self._events.values(), key=lambda event: (event.last_at, event.number))

    def began(self, about: str) -> float | None:
        """Return since when something is wrong, such as `line hall`; None if no event has told of it."""
        kind = about.partition(" ")[0]
        known = self.all()
        ended = max((each.last_at for each in known if about in each.ends or kind in each.ends), default=0.0)
        begun = (each for each in known if each.begins == about and each.last_at >= ended)
        return min((each.first_at if each.first_at >= ended else each.last_at for each in begun), default=None)

    def load(self, events: Iterable[LastEvent]) -> None:
        """Put the events of earlier runs before those of this one."""
        with self._lock:
            before = sorted(events, key=lambda event: event.number)
            by = before[-1].number if before else 0
            ours = [each._replace(number=each.number + by) for each in self._events.values()]
            self._events, self._kinds, self._sizes = {}, {}, {}
            for each in (*before, *ours):
                self._keep(each)
            self._number += by
            self._gone = set()  # none of these is in the file
            self._new, self._counted = ({number + by for number in some} for some in (self._new, self._counted))
            for subject in (*self._subjects.values(), *self._recent.values()):
                subject.number += by
            self.changed += 1
            self._bound()

    def changes(self) -> Changes:
        """Take what has changed since the last time; mere counts every COUNTS_EVERY seconds only."""
        with self._lock:
            now = self._clock()
            if not (self._new or self._gone or abs(now - self._counted_at) >= COUNTS_EVERY):
                return Changes((), frozenset())
            self._counted_at = now
            numbers, gone = self._new | self._counted, frozenset(self._gone)
            self._new, self._counted, self._gone = set(), set(), set()
            return Changes([self._events[number] for number in sorted(numbers)], gone)

    def put_back(self, changes: Changes) -> None:
        """Take back changes that could not be written."""
        with self._lock:
            self._new.update(self._events.keys() & {event.number for event in changes.written})
            self._gone.update(changes.gone - self._events.keys())

    def change_all(self) -> None:
        """Count all of it as changed: nothing of it is in the file any more."""
        with self._lock:
            self._new.update(self._events)

    def count_now(self) -> None:
        """Let the next `changes` have mere counts too."""
        with self._lock:
            self._new |= self._counted

    def _subject(self, event: Event, now: float) -> _Subject:
        """Find what an event is about; all further ones of a kind are one thing if there are too many."""
        key = _key(event)
        subject = self._subjects.get(key)
        if subject is not None and 0 <= now - subject.since < ALIKE_FOR:
            return subject
        recent = self._recent.get(event.name)
        if recent is None or not 0 <= now - recent.since < OF_A_KIND_FOR:
            recent = self._recent[event.name] = _Subject(now)
        recent.count += 1
        if is_many := recent.count > MOST_OF_A_KIND:
            key = (event.name,)
            subject = self._subjects.get(key)
            if subject is not None and subject.is_many and 0 <= now - subject.since < ALIKE_FOR:
                return subject
        subject = self._subjects[key] = _Subject(now, is_many=is_many)
        self._subjects.move_to_end(key)
        if len(self._subjects) > _MOST_SUBJECTS:
            self._subjects.popitem(last=False)
        return subject

    def _append(self, event: Event, now: float, before: str) -> int:
        fields = {name: _short(value) for name, value in event.fields().items() if name != _LEFT_OUT}
        self._number += 1
        self.changed += 1
        text, begins = _short(" ".join(f"{before}{event.in_words()}".split())), event.in_words(event.begins)
        ends = tuple(map(event.in_words, event.ends))
        about = event.name, event.level, text, fields, begins, ends
        new = LastEvent(self._number, self.changed, now, now, number_of(event), *about)
        self._keep(new._replace(size=len(new.row()[1])))
        self._new.add(self._number)
        return self._number

    def _count(self, event: LastEvent, now: float, more: int) -> None:
        self.changed += 1
        self._counted.add(event.number)
        # `_replace` would take three times as long
        again = LastEvent(event.number, self.changed, event.first_at, now, event.times + more, *event[5:])
        self._events[event.number] = again

    def _keep(self, event: LastEvent) -> None:
        self._events[event.number] = event
        self._kinds.setdefault(event.name, deque()).append(event.number)
        self._sizes[event.name] = self._sizes.get(event.name, 0) + event.size

    def _bound(self) -> None:
        """Drop the oldest of the kinds that take most of the room, a tenth of all: a file is cleared less often."""
        if len(self._events) <= MOST_EVENTS and sum(self._sizes.values()) <= MOST_BYTES:
            return
        while len(self._events) > 0.9 * MOST_EVENTS or sum(self._sizes.values()) > 0.9 * MOST_BYTES:
            name = max(self._sizes, key=lambda name: self._sizes[name])
            number = self._kinds[name].popleft()
            self._sizes[name] -= self._events.pop(number).size
            self._new.discard(number)
            self._counted.discard(number)
            self._gone.add(number)


def _key(event: Event) -> tuple[object, ...]:
    """Return what events about the same thing have in common."""
    told = vars(event)
    has_client, values_of = _parts(event.field_names)
    return (event.name, values_of(told), _host(told["client"]) if has_client else "")


@cache
def _parts(fields: tuple[str, ...]) -> tuple[bool, Callable[[dict[str, object]], object]]:
    """Tell whether the key of an event with these fields has a client, and what returns its other values."""
    names = [name for name in fields if name in _KEY and name != "client"]
    return "client" in fields, itemgetter(*names) if names else lambda _: ()


def _host(client: str) -> str:
    return client.rpartition(":")[0] or client


def _short(value: Any) -> Any:
    """Bound a value of a field."""
    if isinstance(value, str):
        return value if len(value) <= _LONGEST else f"{value[:_LONGEST]}..."
    if isinstance(value, tuple | list):
        names = [_short(each) for each in value[:_MOST_NAMES]]
        return names if len(value) <= _MOST_NAMES else [*names, f"and {len(value) - _MOST_NAMES} more"]
    return value
