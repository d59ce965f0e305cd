"""Connects the polls of a device to the clock and the event loop."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any
from weakref import WeakValueDictionary

from gateway.clock.lazy_timer import LazyTimer
from gateway.events import Emit, PartFailed
from gateway.images.drivers.heard_driver import HeardDriver, HeardSource
from gateway.images.polled_range import Part
from gateway.images.polling import DevicePolls, PolledTarget, PolledUnit
from gateway.images.turns import PollTurns
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.request import Caller, Origin, Request, Target


class PollsDriver(Origin):
    """Passes time to its `polls`, and is their Origin.

    An unexpected error is contained here: it is logged, and polling goes on.
    """

    def __init__(
        self, unit: PolledUnit, target: PolledTarget, turns: PollTurns, loop: asyncio.AbstractEventLoop, emit: Emit
    ) -> None:
        self.polls = DevicePolls(unit, target, self, turns, emit)
        self.target = target
        self.caller = Caller.without_address(f"polls of {unit.name}")
        self._emit = emit
        self._time = loop.time
        self._timer = LazyTimer(loop, self._wake)

    def change(self, come: Iterable[Part] = (), gone: Iterable[Part] = ()) -> None:
        """Poll for the parts that `come`, and no more for those that are `gone`."""
        self._run(self.polls.change, tuple(come), tuple(gone), self._time())
        readers = ", ".join(reader.label for reader in self.polls.readers)
        self.caller = Caller.without_address(readers or self.caller.client)

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting poll should be sent."""
        return self.polls.wants(request)

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to a poll."""
        self._run(self.polls.polled, request, pdu, self._time())

    def wrote(self, span: Span | None) -> None:
        """Note that a write to `span` has finished, or one to any address if that is None."""
        self._run(self.polls.changed, span, self._time())

    def changed(self) -> None:
        """Set the timer again: polls may be due at another time than before."""
        self._timer.set(self.polls.deadline())

    def _wake(self) -> None:
        self._run(self.polls.tick, self._time())

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - the error boundary of polls: a defect must not reach the line
            self._emit(PartFailed.of(self.caller.client, error))
        self.changed()


class AtOnce(Target):
    """An image, a mirror or a virtual unit that is polled: nobody waits for it, and it never backs off."""

    def __init__(self, destination: Target) -> None:
        self.holes = Holes()
        self.destination = destination

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:  # noqa: ARG002 - nobody waits
        """See PolledTarget."""
        self.destination.submit(request, now)

    def is_resting(self, now: float) -> bool:  # noqa: ARG002 - at any time
        """See PolledTarget."""
        return False


class Pollers:
    """The polls of everything that is polled, as long as somebody wants them: a reload keeps those of what stays.

    What is heard of devices that only others ask is here too.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self._loop = loop
        self._emit = emit
        #: By the identity of the target, or of what answers at once.
        self._drivers: WeakValueDictionary[int, PollsDriver] = WeakValueDictionary()
        self._heard: WeakValueDictionary[int, HeardDriver] = WeakValueDictionary()
        #: By the name of the line; what has none has turns of its own.
        self._turns: dict[str, PollTurns] = {}

    def of(self, target: PolledTarget, unit: PolledUnit, line: str = "") -> PollsDriver:
        """Return the polls of a target, which is on this line."""
        turns = self._turns.setdefault(line, PollTurns()) if line else PollTurns()
        return self._of(id(target), target, unit, turns)

    def at_once(self, target: Target, unit: PolledUnit) -> PollsDriver:
        """Return the polls of an image, a mirror or a virtual unit."""
        return self._of(id(target), AtOnce(target), unit, PollTurns())

    def heard(self, source: HeardSource) -> HeardDriver:
        """Return what is heard of a device of a monitor line."""
        found = self._heard.get(id(source))
        if found is None:
            found = self._heard[id(source)] = HeardDriver(source, self._loop, self._emit)
        return found

    def _of(self, identity: int, polled: PolledTarget, unit: PolledUnit, turns: PollTurns) -> PollsDriver:
        found = self._drivers.get(identity)
        if found is None:
            found = self._drivers[identity] = PollsDriver(unit, polled, turns, self._loop, self._emit)
        return found
