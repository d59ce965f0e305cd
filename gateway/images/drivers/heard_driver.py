"""Connects what is heard of a device to those who want its values."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from gateway.events import Emit, PartFailed
from gateway.images.heard_values import HeardValues
from gateway.images.polled_range import Part
from gateway.lines.monitor.monitor import HeardTransaction


class HeardSource(Protocol):
    """A device of a monitor line. `take` is called with all that is heard of it."""

    name: str
    take: Callable[[HeardTransaction, float], None] | None


class HeardDriver:
    """Passes what is heard of `source` on to `polls`, as PollsDriver does with responses: nothing is asked here.

    An unexpected error is contained here: it is logged, and listening goes on.
    """

    def __init__(self, source: HeardSource, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self.polls = HeardValues()
        self.source = source
        self._emit = emit
        self._time = loop.time
        source.take = self._heard

    def change(self, come: Iterable[Part] = (), gone: Iterable[Part] = ()) -> None:
        """Supply the parts that `come`, and no more those that are `gone`."""
        self._run(self.polls.change, tuple(come), tuple(gone), self._time())

    def changed(self) -> None:
        """Do nothing: no poll is due."""

    def _heard(self, transaction: HeardTransaction, now: float) -> None:
        self._run(self.polls.heard, transaction, now)

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - the error boundary of values: a defect must not reach the line
            self._emit(PartFailed.of(f"values heard of {self.source.name}", error))
