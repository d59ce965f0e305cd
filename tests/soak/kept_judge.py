"""Judges what a gateway has published of what its devices have answered, by the record of a run.

`judge` takes a Record and returns the problems in it: what was lost, told twice, out of order, with a wrong time, or as
new when it was old, and history that was sent too fast or in a wrong way. It needs values that occur once: each answer
of a device has a number of its own, which all of its values are, or are made of.
"""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from gateway.plant.kept.history import SETTLING
from soak.kept_record import Entry, Record, Told

#: How much earlier than it was answered a value may seem to be, in seconds.
EARLY = 0.05
#: A late answer comes so soon after its limit, in seconds.
SOON = 0.3
#: The most history messages in a second, and how exactly their times are seen, in seconds.
MOST_IN_A_SECOND, BLUR = 10, 0.05
#: Kinds of problems.
LOST: Final = "lost"
INVENTED: Final = "never answered"
WRONG_TIME: Final = "wrong time"
DOUBLED: Final = "told twice"
UNRECOGNISABLE: Final = "told twice with two times"
DISORDER: Final = "out of order"
OLD: Final = "old, but live"
BACKWARDS: Final = "live, but older than before"
TOO_FAST: Final = "history too fast"
NOT_ALONE: Final = "two history messages in flight"
BEFORE_LIVE: Final = "history before a live value"
MANNER: Final = "sent in a wrong way"
CLOCK: Final = "wrong about the clock"


class Problem(NamedTuple):
    """What is wrong with a value, and when it was answered or sent."""

    kind: str
    at: float
    text: str


class _Given:
    """What devices have answered, by value."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._times: dict[tuple[str, str, int], list[float]] = defaultdict(list)
        for answer in record.answers:
            for point, value in answer.values.items():
                self._times[answer.device, point, value].append(answer.at)

    def find(self, device: str, point: str, value: int, told: float, by: float) -> float | None:
        """When this value was answered: at the time nearest to the one that is `told`. None if never before `by`."""
        times = self._times.get((device, point, value), ())
        if len(times) == 1:
            return times[0] if times[0] <= by else None
        before = [at for at in times if at <= by]
        return min(before, key=lambda at: abs(at + self._record.offset(at) - told), default=None)


def judge(record: Record) -> list[Problem]:
    """Return all problems."""
    given = _Given(record)
    problems = [*_lost(record), *_Hearing(record, given).problems(), *_ages(record, given), *_manners(record)]
    problems += _before_live(record, given)
    return sorted(problems, key=lambda problem: problem.at)


def _lost(record: Record) -> Iterator[Problem]:
    """What had to come, and did not."""
    came = {
        (told.device, point, value)
        for told in record.heard
        for entry in told.entries
        for point, value in entry.values.items()
    }
    for answer in record.answers:
        if any(begin < answer.at <= end for begin, end in record.may_lose):
            continue
        if any(answer.device == device and abs(answer.at - at) < SOON for device, at in record.too_late):
            continue
        for point, value in answer.values.items():
            if (answer.device, point, value) not in came:
                yield Problem(LOST, answer.at, f"{answer.device} {point} {value} of {answer.at:.3f}")


class _Before(NamedTuple):
    """How an answer was told before: when that was heard, and with which time."""

    heard: float
    told: float
    was_history: bool


class _Hearing:
    """Follows what comes: whether it was answered, its time, its order, and what comes twice."""

    def __init__(self, record: Record, given: _Given) -> None:
        self._record = record
        self._given = given
        self._seen: dict[tuple[str, str, float], _Before] = {}
        #: The newest answer that was told, for each point, in history and else.
        self._newest: dict[tuple[str, str, bool], float] = defaultdict(float)
        self._last_time: dict[str, float] = defaultdict(float)

    def problems(self) -> Iterator[Problem]:
        for told in self._record.heard:
            for entry in told.entries:
                yield from self._entry(told, entry)

    def _entry(self, told: Told, entry: Entry) -> Iterator[Problem]:
        answered = {}
        for point, value in entry.values.items():
            at = self._given.find(told.device, point, value, entry.at, told.at)
            if at is None:
                yield Problem(INVENTED, told.at, f"{told.device} {point} {value} at {entry.at:.3f}")
            elif not (told.shares_time and point in self._record.slow):  # it does not tell which of its answers
                answered[point] = at
        if not answered:
            return
        yield from _time(self._record, told, entry, answered)
        new = max(answered.values())
        for point, at in answered.items():
            if point not in self._record.slow and (at == new or not told.shares_time):
                yield from self._value(told, entry, point, at)
        if told.shares_time and len(self._record.clock) == 1:
            if entry.at < self._last_time[told.device]:
                what = f"{told.device} at {entry.at:.3f} after {self._last_time[told.device]:.3f}"
                yield Problem(BACKWARDS, told.at, what)
            self._last_time[told.device] = entry.at

    def _value(self, told: Told, entry: Entry, point: str, at: float) -> Iterator[Problem]:
        """A value that the entry tells with its own time."""
        key, place = (told.device, point, at), (told.device, point, told.is_history)
        before, newest = self._seen.get(key), self._newest[place]
        self._seen[key] = _Before(told.at, entry.at, told.is_history)
        self._newest[place] = max(at, newest)
        if before is not None:
            yield from _twice(self._record, told, entry, point, before)
        if at < newest and (before is None or not told.is_history):
            what = f"{told.device} {point} {entry.values[point]} of {at:.3f} after that of {newest:.3f}"
            yield Problem(DISORDER if told.is_history else BACKWARDS, told.at, what)


def _kind(*, is_history: bool) -> str:
    return "in history" if is_history else "live"


def _time(record: Record, told: Told, entry: Entry, answered: Mapping[str, float]) -> Iterator[Problem]:
    """Whether an entry has the time of its answer: history of each value, a message with all values of the newest."""
    for at in {max(answered.values())} if told.shares_time else {*answered.values()}:
        ahead = {record.offset(at), *({record.offset(told.at)} if not told.is_history else ())}
        if not any(-EARLY <= entry.at - at - each <= record.late for each in ahead):
            what = f"{told.device} {dict(entry.values)} of {at:.3f} is told as of {entry.at:.3f}"
            what = f"{what} {_kind(is_history=told.is_history)}"
            yield Problem(WRONG_TIME, told.at, what)
        if told.is_history:
            must = record.offset(at) != record.offset(told.at)
            if must != entry.is_unsure:
                what = f"{told.device} of {at:.3f}, sent at {told.at:.3f}: unsure is {entry.is_unsure}"
                yield Problem(CLOCK, told.at, what)


def _twice(record: Record, told: Told, entry: Entry, point: str, before: _Before) -> Iterator[Problem]:
    """Whether a value may come a second time, and has the same time."""
    first = f"as of {before.told:.3f} at {before.heard:.3f} {_kind(is_history=before.was_history)}"
    again = f"as of {entry.at:.3f} at {told.at:.3f} {_kind(is_history=told.is_history)}"
    what = f"{told.device} {point} {entry.values[point]}: {first}, {again}"
    if before.told != entry.at and len(record.clock) == 1:
        yield Problem(UNRECOGNISABLE, told.at, what)
    is_birth = not told.is_history and any(before.heard - record.late <= end <= told.at for end in record.ends)
    is_cut_short = told.is_history and not before.was_history
    longer = SETTLING if is_cut_short else 0.0  # what a birth has told comes again if history had not begun
    is_unclean = any(
        each.at - each.reach - longer <= before.heard <= each.at + record.late / 3 and each.at <= told.at
        for each in (*record.breaks, *(record.clean_ends if is_cut_short else ()))
    )
    if not (is_birth or is_unclean):
        yield Problem(DOUBLED, told.at, what)


def _ages(record: Record, given: _Given) -> Iterator[Problem]:
    """Whether what was sent as new was new."""
    for told in record.sent:
        if told.is_history:
            continue
        for entry in told.entries:
            for point, value in entry.values.items():
                at = given.find(told.device, point, value, entry.at, told.at)
                if at is not None and told.at - at > record.every[point] + record.limit + record.late:
                    yield Problem(OLD, told.at, f"{told.device} {point} {value} of {at:.3f}: {told.at - at:.3f} s old")


def _manners(record: Record) -> Iterator[Problem]:
    """Whether messages were sent as they must be."""
    history = [told for told in record.sent if told.is_history]
    for told in record.sent:
        manner = (told.qos, told.is_retained)
        if manner != ((record.history_qos, False) if told.is_history else (record.live_qos, record.live_retained)):
            yield Problem(MANNER, told.at, f"{told.device}: QoS {told.qos}, retained is {told.is_retained}")
    for first, last in zip(history, history[MOST_IN_A_SECOND:], strict=False):
        if last.at - first.at < 1.0 - BLUR:
            yield Problem(TOO_FAST, last.at, f"{MOST_IN_A_SECOND + 1} messages in {last.at - first.at:.3f} s")
    if record.history_qos:
        for one, other in pairwise(history):
            if one.connection == other.connection and (one.confirmed_at is None or one.confirmed_at > other.at):
                yield Problem(NOT_ALONE, other.at, f"{one.device} was not confirmed before {other.device}")


def _before_live(record: Record, given: _Given) -> Iterator[Problem]:
    """Whether history was sent while a live value waited."""
    history: dict[int, list[float]] = defaultdict(list)
    for told in record.sent:
        if told.is_history:
            history[told.connection].append(told.at)
    for told in record.sent:
        times = history.get(told.connection)
        if told.is_history or not times:
            continue
        found = (
            given.find(told.device, point, value, entry.at, told.at)
            for entry in told.entries
            for point, value in entry.values.items()
        )
        new = max((at for at in found if at is not None), default=told.at)
        # Between when it was read and when it was sent: after the first of this connection, which follows the birth.
        begin = bisect_left(times, max(new + record.late, times[0]))
        if begin < bisect_left(times, told.at):
            yield Problem(BEFORE_LIVE, told.at, f"{told.device}: a value of {new:.3f} waited until {told.at:.3f}")


def count(problems: Sequence[Problem]) -> dict[str, int]:
    """How many there are of each kind."""
    counts: dict[str, int] = defaultdict(int)
    for problem in problems:
        counts[problem.kind] += 1
    return dict(counts)
