"""Several gateways, one lease and its store, in which anything may happen at any moment.

A gateway is killed and started, stopped and continued, hears another asker, or gives the lease back. A question to the
store, or its answer, is slow or lost, or the question is carried out long after nobody waits for it any more. The store
loses what it has, or comes back older, unless a gateway has seen nothing of what it lost. The clocks of the gateways
have nothing in common, and run at different rates.

What may never happen: one gateway may write while what another one has written may still be on the line, or while the
answer to that may come late, unless that other one has said how long that is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.fleet.lease import Lease, LeaseSettings, Read, StoreCall, Write

SETTINGS = LeaseSettings("hall-a", ttl=20.0, guard=3.0, late=4.0)
#: How long time may pass without anything else, in seconds.
STEPS = (1.0, 4.0, 15.0)
_PASSES = tuple(f"pass {step:g}" for step in STEPS)
#: By how much the fastest clock is too fast: a silence is counted by that of the next holder.
_FASTEST = 1.1
#: Questions that nobody waits for any more, of one gateway.
_STRAY = 1
#: By how many changes the store is older when it comes back.
_OLDER = (1, 2, 6)
#: What a picture of a lease leaves out, and what is no point in time there.
_LEFT_OUT = frozenset({"settings", "reason", "_holder", "_instance", "sent", "_store", "_writes"})
_PERIODS = frozenset({"_silence", "_ttl", "longest"})


@dataclass
class Gateway:
    """One gateway; its clock shows `offset` + `rate` x true time."""

    lease: Lease
    rate: float
    offset: float
    is_stopped: bool = False
    asked: StoreCall | None = None
    #: What the store has answered, on its way: how to report it.
    answer: tuple[Any, ...] | None = None
    stray: tuple[StoreCall, ...] = ()
    #: Whether its connection to the store is lost, which it does not know yet.
    is_cut: bool = False
    #: The true time at which it could write last.
    wrote: float = -inf
    #: For how long after that the others must be silent, by what it has said.
    owes: float = 0.0
    #: The revision of the last entry that it saw.
    saw: int = 0


@dataclass
class World:
    """All of it. `wrong` says what should never have happened."""

    rates: tuple[float, ...]
    settings: LeaseSettings = SETTINGS
    now: float = 1000.0
    value: bytes | None = None
    revision: int = 0
    #: What the store had before, by revision.
    past: dict[int, bytes] = field(default_factory=dict)
    #: Until when no gateway can start that has seen nothing of what the store has lost.
    starts_at: float = -inf
    started: int = 0
    gateways: list[Gateway | None] = field(default_factory=list)
    #: What gateways that are gone have left on the line, by true time.
    gone: list[Gateway] = field(default_factory=list)
    wrong: str = ""

    def __post_init__(self) -> None:
        self.gateways = [None] * len(self.rates)
        for number in range(len(self.rates)):
            self._start(number)

    def copy(self) -> "World":
        """Another world in the same state."""
        there = _twin(self)
        there.gateways = [one and _copied(one) for one in self.gateways]
        there.gone = list(self.gone)
        there.past = dict(self.past)
        return there

    def happenings(self) -> Iterator[str]:
        """What may happen now."""
        yield from _PASSES
        if self.value is not None:
            yield "wipe 0"
            yield from (f"roll back {older}" for older in _OLDER if self._may_roll_back(self.revision - older))
        for number, one in enumerate(self.gateways):
            if one is not None or self.now >= self.starts_at:
                for what in ("start",) if one is None else _happenings(one):
                    yield f"{what} {number}"

    def do(self, happening: str) -> None:
        """Let it happen."""
        what, _, which = happening.rpartition(" ")
        getattr(self, "_" + what.replace(" ", "_"))(float(which) if what == "pass" else int(which))
        self._look()

    def picture(self) -> tuple[Any, ...]:
        """Two worlds with the same picture have the same future."""
        return (
            self._entry(self.value),
            self.revision,
            *(self.past.get(self.revision - older) for older in _OLDER),
            max(0.0, self.starts_at - self.now),
            *(one and self._picture_of(one) for one in self.gateways),
            *((max(one.wrote - self.now, -SETTINGS.ttl), one.owes) for one in self.gone),
        )

    def _picture_of(self, one: Gateway) -> tuple[Any, ...]:
        clock, long_ago = self._clock(one), -2 * SETTINGS.ttl
        lease = tuple(
            max(value - clock, long_ago) if isinstance(value, float) and name not in _PERIODS else value
            for part in (one.lease, one.lease._store, one.lease._writes)
            for name, value in vars(part).items()
            if name not in _LEFT_OUT
        )
        sent = tuple((beat, at - clock) for beat, at in one.lease._writes.sent.items())
        owed = (max(one.wrote - self.now, long_ago), one.owes)
        return (str(lease), sent, one.is_stopped, one.asked, one.answer, one.stray, one.is_cut, one.saw, owed)

    def _entry(self, value: bytes | None) -> bytes | None:
        return value

    def _clock(self, one: Gateway) -> float:
        return one.offset + one.rate * self.now

    def _one(self, number: int) -> Gateway:
        one = self.gateways[number]
        assert one is not None
        return one

    def _pass(self, seconds: float) -> None:
        """Time passes. Each gateway writes as long as it may."""
        for one in self.gateways:
            if one is not None and not one.is_stopped:
                left = (one.lease.until - self._clock(one)) / one.rate
                silent = (one.lease.silent_until - self._clock(one)) / one.rate
                if left > 0 and silent < min(left, seconds):
                    begins, ends = self.now + max(0.0, silent), self.now + min(left, seconds)
                    self._writes(one, begins, ends)
        self.now += seconds

    def _look(self) -> None:
        """Who may write at this moment."""
        for one in self.gateways:
            if one is not None and not one.is_stopped:
                clock = self._clock(one)
                if one.lease.may_send(clock) and clock >= one.lease.silent_until:
                    self._writes(one, self.now, self.now)

    def _writes(self, one: Gateway, begins: float, ends: float) -> None:
        for other in (*self.gone, *self.gateways):
            if other is not None and other is not one and begins < other.wrote + other.owes:
                self.wrong = f"one writes at {begins:g}, another at {other.wrote:g}, who owes {other.owes:g}"
        one.wrote = max(one.wrote, ends)
        one.owes = (self.settings.guard + self.settings.late) / _FASTEST

    def _start(self, number: int) -> None:
        self.started += 1
        instance = f"{number} {self.started}"
        self.gateways[number] = Gateway(
            Lease(self.settings, f"plant-{number}", instance), self.rates[number], 77.0 * number
        )

    def _kill(self, number: int) -> None:
        one = self._one(number)
        self.gone = [each for each in (*self.gone, one) if each.wrote > self.now - self.settings.ttl]
        self.gateways[number] = None

    def _stop(self, number: int) -> None:
        self._one(number).is_stopped = True

    def _go_on(self, number: int) -> None:
        self._one(number).is_stopped = False

    def _ask(self, number: int) -> None:
        one = self._one(number)
        one.asked = one.lease.next(self._clock(one))
        if one.asked is None and one.lease.deadline() <= self._clock(one):
            self.wrong = f"{one.lease} waits for a time in the past"

    def _serve(self, number: int) -> None:
        one = self._one(number)
        assert one.asked is not None
        one.answer = self._carry_out(one.asked)

    def _carry_out(self, asked: StoreCall) -> tuple[Any, ...]:
        if isinstance(asked, Read):
            return ("found", self.value, 0 if self.value is None else self.revision)
        if asked.revision != (0 if self.value is None else self.revision):
            return ("refused",)
        self.value = asked.value
        self.revision += 1
        self.past[self.revision] = asked.value
        self.past.pop(self.revision - max(_OLDER) - 1, None)
        return ("written", self.revision)

    def _answer(self, number: int) -> None:
        one = self._one(number)
        assert one.answer is not None
        (report, *arguments), one.answer, one.asked = one.answer, None, None
        if report != "refused":
            one.saw = arguments[-1] or one.saw
        getattr(one.lease, report)(*arguments, self._clock(one))

    def _lose(self, number: int) -> None:
        """Nobody waits for the answer any more. A question that was not carried out may still be."""
        one = self._one(number)
        if isinstance(one.asked, Write) and one.answer is None and not one.is_cut:
            one.stray = (*one.stray, one.asked)[-_STRAY:]
        one.asked = one.answer = None
        one.is_cut = False
        one.lease.failed("no answer", self._clock(one))

    def _stray(self, number: int) -> None:
        one = self._one(number)
        (asked, *rest), one.stray = one.stray, ()
        one.stray = tuple(rest)
        self._carry_out(asked)

    def _wipe(self, _: int) -> None:
        """The store was away and has lost the entry. It counts from 0, and what was under way to it is lost too."""
        self.value, self.revision, self.past = None, 0, {}
        self._restart()

    def _may_roll_back(self, revision: int) -> bool:
        """Whether the store had this, and every gateway has seen something later."""
        return revision in self.past and all(one.saw > revision for one in self.gateways if one is not None)

    def _roll_back(self, older: int) -> None:
        """The store was away, and comes back as it was so many changes ago."""
        self.revision -= older
        self.value = self.past[self.revision]
        self.past = {revision: value for revision, value in self.past.items() if revision <= self.revision}
        self.starts_at = self.now + self.settings.ttl
        self._restart()

    def _restart(self) -> None:
        """What was under way to the store is lost."""
        for one in self.gateways:
            if one is not None:
                one.stray, one.is_cut = (), True

    def _hear(self, number: int) -> None:
        one = self._one(number)
        one.lease.heard_other(self._clock(one))

    def _release(self, number: int) -> None:
        """It stops in order: what was on the line is over, and the late answers are told."""
        one = self._one(number)
        one.lease.release(0.0, {})
        one.owes = 0.0


def _happenings(one: Gateway) -> Iterator[str]:
    yield "kill"
    yield "go on" if one.is_stopped else "stop"
    if one.stray:
        yield "stray"
    if one.asked is not None and one.answer is None and not one.is_cut:
        yield "serve"
    if not one.is_stopped:
        if one.answer is not None:
            yield "answer"
        yield "ask" if one.asked is None else "lose"
        if one.lease.is_held:
            yield "hear"
            yield "release"


def _twin(one: Any) -> Any:
    """What `copy` makes of an object with a `__dict__`, in a third of its time."""
    there = object.__new__(type(one))
    there.__dict__.update(one.__dict__)
    return there


def _copied(one: Gateway) -> Gateway:
    there = _twin(one)
    there.lease = _twin(one.lease)
    there.lease._store = _twin(one.lease._store)
    there.lease._writes = _twin(one.lease._writes)
    there.lease._writes.sent = dict(one.lease._writes.sent)
    return there
