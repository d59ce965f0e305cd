"""Decides what is published, and when: between what is read of devices and the connection to a broker.

It has no timer and no connection: `deadline` says when to call `tick`, messages are taken from it, and deliveries are
handed to it. Without a connection it keeps the last reading of each point.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from gateway.events import Emit
from gateway.plant.births import Births
from gateway.plant.changes import Watch
from gateway.plant.commands import CarriedOut, Commands, TakesResponse
from gateway.plant.kept.history import History
from gateway.plant.messages import (
    Command,
    Delivery,
    DeviceState,
    Form,
    Leave,
    Message,
    Misdirected,
    Readings,
    Rebirth,
)
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice
from gateway.registers.datatypes import Value
from gateway.request import Target

#: The most results that wait to be published; for further ones the oldest are dropped.
MOST_RESULTS: Final = 100


@dataclass(frozen=True, slots=True)
class PublisherSettings:
    """The devices to publish. `patience` is the longest time of a read, in seconds, by name of the device.

    `source` is the place of the table in the config.
    """

    devices: tuple[PublishedDevice, ...]
    patience: Mapping[str, float]
    source: str


class _Results:
    """Results that wait to be published, in turn with all other messages."""

    def __init__(self) -> None:
        self.waiting: deque[Message] = deque()
        self._was_last = False

    def add(self, results: Iterable[Message]) -> int:
        """Add results; return how many older ones were dropped for them."""
        self.waiting.extend(results)
        dropped = max(0, len(self.waiting) - MOST_RESULTS)
        for _ in range(dropped):
            self.waiting.popleft()
        return dropped

    def take(self, *, is_alone: bool) -> Message | None:
        """Return the next result if it is their turn, else None. If `is_alone`, it always is."""
        self._was_last = bool(self.waiting) and (is_alone or not self._was_last)
        return self.waiting.popleft() if self._was_last else None


class Publisher:
    """Publishes `settings.devices` in a `form`; writes go to `writes_to`, and `responses_to` takes the responses.

    `clock` is the clock of every `now`; `unix` converts its times to Unix times. With a `history`, readings that are to
    be published and cannot be are kept there.
    """

    def __init__(
        self,
        settings: PublisherSettings,
        form: Form,
        writes_to: Target,
        responses_to: TakesResponse,
        emit: Emit,
        clock: Callable[[], float],
        unix: Callable[[float], float],
        carried_out: CarriedOut,
        history: History | None = None,
    ) -> None:
        #: Results that were not published, because there were too many.
        self.dropped_results = 0
        self.form = form
        #: Whether the connection must be ended, and a new one made.
        self.must_leave = False
        self.commands = Commands(writes_to, responses_to, emit, clock, self._tell, carried_out)
        self.history = history
        self._clock = clock
        self._unix = unix
        self._watches = {
            device.name: Watch(device, settings.patience.get(device.name, 0.0)) for device in settings.devices
        }
        self._is_connected = False
        self._births = Births()
        self._results = _Results()
        self._came_or_went: dict[str, None] = {}
        self._changed: dict[str, None] = {}
        self._refused: set[str] = set()

    @property
    def watches(self) -> Mapping[str, Watch]:
        """The watch of each device, by its name."""
        return self._watches

    @property
    def has_messages(self) -> bool:
        """Whether `take` has something to publish."""
        return self.is_born and bool(self.has_birth or self._came_or_went or self._changed or self._results.waiting)

    @property
    def waiting(self) -> int:
        """How many messages `take` would give now, if there were a connection."""
        return len(self._came_or_went) + len(self._changed) + len(self._results.waiting)

    def deadline(self, now: float) -> float | None:
        """Return when `tick` must be called, or None."""
        history_at = None if self.history is None else self.history.deadline()
        if history_at is None or history_at <= now:  # the next `take` looks
            return self._births.next_at
        return history_at if self._births.next_at is None else min(history_at, self._births.next_at)

    def has_history(self, now: float) -> bool:
        """Tell whether it is time to look for kept readings to send."""
        at = None if self.history is None else self.history.deadline()
        return at is not None and now >= at

    def tick(self, now: float) -> None:
        """Begin a birth that was put off."""
        if self._births.next_at is not None and now >= self._births.next_at:
            self._be_born(now)

    def took(self, device: str, items: Iterable[tuple[Point, bytes]], now: float) -> None:
        """Take the items of points that one request has read."""
        self._heed(device, {point.name: point.value(own) for point, own in items}, now, answers=True)

    def missed(self, device: str, now: float, *, answers: bool | None) -> None:
        """Note that a request has read nothing. `answers`: whether the device answers; None if it was not asked."""
        self._heed(device, {}, now, answers=answers)

    def will(self, now: float) -> Message:
        """Return the message that the broker publishes when the connection is lost. Begins a session."""
        self.must_leave = False
        return self.form.will(self._unix(now))

    def connected(self, now: float) -> None:
        """Begin the birth, unless it is held: the connection and the early subscriptions are made."""
        self._is_connected = True
        if not self.form.is_held:
            self._be_born(now)

    def disconnected(self) -> None:
        """Drop everything that was not published: the connection is lost. The last readings remain.

        With a history, the new readings of what was not confirmed and those that waited to be published are kept.
        """
        self._is_connected = False
        self._births.forget()
        self._results.waiting.clear()
        self._refused.clear()
        self._came_or_went.clear()
        self._changed.clear()
        if self.history is not None:
            self.history.end()
        self._keep_all_due()

    @property
    def has_birth(self) -> bool:
        """Whether some messages of a birth were not taken yet."""
        return self._births.is_under_way

    @property
    def is_born(self) -> bool:
        """Whether a birth has begun in this connection."""
        return self._births.has_begun

    def take(self, now: float) -> Sequence[Message]:
        """Return the next messages to publish, in this order; none if there are none at present.

        Results and all else take turns.
        """
        if not self.is_born:
            return ()
        message = self._births.take() or self._results.take(is_alone=not (self._came_or_went or self._changed))
        if message is not None:
            return (message,)
        if self._came_or_went:
            return self._telling(self._availability(_pop(self._came_or_went), now), now)
        if self._changed:
            return self._telling(self._values(_pop(self._changed), now), now)
        earlier = None if self.history is None else self.history.take(now, self._unix(now))
        return () if earlier is None else (earlier,)

    def _telling(self, messages: Sequence[Message], now: float) -> Sequence[Message]:
        """Have the new readings in messages kept if the broker does not confirm them."""
        for message in messages:
            if self.history is not None and message.told:
                self.history.telling(message, now)
        return messages

    def begin_history(self, now: float, largest: int) -> None:
        """Begin to publish kept readings, in messages of at most `largest` bytes: the broker has the birth."""
        if self.history is not None:
            self.history.begin(now, largest)

    def confirmed(self, message: Message, now: float) -> None:
        """Note that the broker has a message."""
        if self.history is not None:
            self.history.confirmed(message, now)
            if message.birth == self._births.number:
                self.history.confirmed_birth(message.device)

    def refused(self, message: Message, now: float, *, is_passing: bool) -> None:
        """Note that the broker has refused a message.

        If it does so for now only, the next read of the message's device publishes all readings, and this one is kept.
        """
        if self.history is not None and self.history.refused(message, now, is_passing=is_passing):
            return
        if self.history is not None and message.birth:
            self.history.refused_birth(message.device)
        if is_passing and message.device in self._watches:
            self._refused.add(message.device)

    def received(self, delivery: Delivery, now: float) -> None:
        """Do what a message from the broker asks for."""
        refusal = self.commands.refusal(delivery)
        for received in self.form.received(delivery):
            if isinstance(received, Command):
                self.commands.carry_out(received, refusal, now)
            elif isinstance(received, Misdirected):
                self.commands.refuse(received, now)
            elif isinstance(received, Rebirth) and self._is_connected:
                if self._births.may_begin(now):
                    self._be_born(now)
            elif isinstance(received, Leave):
                self.must_leave = True

    def ended(self, now: float) -> Sequence[Message]:
        """Return the last messages to publish."""
        return self.form.ended(self._unix(now)) if self.is_born else ()

    def _be_born(self, now: float) -> None:
        self._keep_all_due()
        for watch in self._watches.values():
            watch.forget()
        self._came_or_went.clear()
        self._changed.clear()
        self._births.begin(self._birth(), now)

    def _birth(self) -> Iterator[Message]:
        """Yield the birth, made when it is taken: commands may have to be subscribed to before."""
        for message in self.form.born(self._states(), self._unix(self._clock())):
            yield replace(message, told={}, birth=self._births.number)  # what had to be published was kept

    def _states(self) -> Iterator[DeviceState]:
        """Yield the state of each device, made when it is taken."""
        for name, watch in self._watches.items():
            self._keep_due(name)  # what has come since the birth began
            state = watch.state(self._clock())
            self._came_or_went.pop(name, None)
            self._changed.pop(name, None)
            watch.published(state.readings)
            if self.history is not None:
                self.history.born(name, state.readings)
            yield state

    def _heed(self, name: str, values: Mapping[str, Value | None], now: float, *, answers: bool | None) -> None:
        watch = self._watches[name]
        was_available = watch.is_available
        dropped = {} if values else watch.expire(now)
        if answers is not None:
            dropped |= watch.answered(values, round(self._unix(now), 3), now) if answers else watch.failed()
            if watch.is_available != was_available or name in self._refused:
                self._refused.discard(name)
                self._came_or_went[name] = None
        self._keep(name, dropped)
        self._note_change(name)

    def _note_change(self, name: str) -> None:
        watch = self._watches[name]
        if self.is_born and watch.changed:
            self._changed[name] = None
        elif watch.changed:
            self._keep_due(name)

    def _keep_all_due(self) -> None:
        for name in self._watches:
            self._keep_due(name)

    def _keep_due(self, name: str) -> None:
        """Keep the readings of a device that are to be published: there is no connection."""
        watch = self._watches[name]
        waiting = watch.waiting()
        if self.history is not None and waiting:
            self._keep(name, waiting)
            watch.published(waiting)

    def _keep(self, name: str, readings: Readings) -> None:
        """Keep readings that are not published, if that is wanted."""
        if self.history is not None:
            self.history.keep(name, readings)

    def _availability(self, name: str, now: float) -> Sequence[Message]:
        watch = self._watches[name]
        self._keep(name, watch.expire(now))
        state = watch.state(now)
        self._changed.pop(name, None)
        watch.published(state.readings)
        if self.history is not None:
            self.history.look()  # it may have waited for this device
        return self.form.availability(state, self._unix(now))

    def _values(self, name: str, now: float) -> Sequence[Message]:
        watch = self._watches[name]
        self._keep(name, watch.expire(now))
        readings = watch.readings(now)
        changed = frozenset(watch.changed)
        if not changed:
            return ()
        watch.published({each: readings[each] for each in changed if each in readings})
        return self.form.values(watch.device, readings, changed, self._unix(now))

    def _tell(self, command: Command | Misdirected, error: str | None, now: float) -> None:
        if self.is_born:
            self.dropped_results += self._results.add(self.form.result(command, error, self._unix(now)))


def _pop(names: dict[str, None]) -> str:
    name = next(iter(names))
    del names[name]
    return name
