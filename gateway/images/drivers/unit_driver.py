"""Connects a mirror or a virtual unit to the clock and the event loop."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from gateway.events import Emit, PartFailed
from gateway.images.drivers.heard_driver import HeardDriver
from gateway.images.drivers.polls_driver import PollsDriver
from gateway.images.ordered import OrderedUnit
from gateway.images.polled_range import Part
from gateway.images.supply import Supply
from gateway.request import NamedTarget, Request

Unit = TypeVar("Unit", bound=OrderedUnit)


#: What drives the polls, or what is heard, of one source.
SupplyDriver = PollsDriver | HeardDriver


class UnitDriver(NamedTarget, Generic[Unit]):
    """A Target that passes requests and time to its `unit`, which `make` makes.

    `pollers` are the polls of its sources by their names. An unexpected error is contained here: it is logged, and its
    request fails.
    """

    def __init__(
        self,
        make: Callable[["UnitDriver[Unit]"], Unit],
        pollers: Mapping[str, SupplyDriver],
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
    ) -> None:
        self.pollers = pollers
        self._emit = emit
        self._time = loop.time
        self._drivers: dict[Supply, SupplyDriver] = {driver.polls: driver for driver in pollers.values()}
        self._is_open = False
        self.unit = make(self)
        self.name = self.unit.name

    def start(self) -> None:
        """Begin to poll, if it has not yet."""
        if not self._is_open:
            self._is_open = True
            for polls, parts in self._parts().items():
                self._drivers[polls].change(come=parts)

    def close(self) -> None:
        """Stop polling. Reads that wait for a poll fail."""
        if self._is_open:
            self._is_open = False
            for polls, parts in self._parts().items():
                self._drivers[polls].change(gone=parts)
        self._run(self.unit.close, self._time())

    def submit(self, request: Request, now: float) -> None:
        """Take a client's request."""
        if not self._run(self.unit.submit, request, now):
            self._run(self.unit.abandon, request)

    def passed(self, request: Request, polls: Supply | None, sent: Request, response: bytes | None) -> None:
        """Take the response to `sent`, which was passed on to a source, or within the unit, for `request`."""
        now = self._time()
        if polls is not None:
            self._run(self.unit.wrote, request, polls, sent, response, now)
        self._run(self.unit.passed, request, response, now)
        if polls is not None:
            self._drivers[polls].changed()

    def _parts(self) -> dict[Supply, list[Part]]:
        found: dict[Supply, list[Part]] = {}
        for polls, part in self.unit.wanted():
            found.setdefault(polls, []).append(part)
        return found

    def _run(self, step: Callable[..., None], *arguments: Any) -> bool:
        """Run a step. Return False if it raised an unexpected error."""
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - the error boundary of a unit: a defect in it must not reach a line
            self._emit(PartFailed.of(self.unit.label, error))
            return False
        return True
