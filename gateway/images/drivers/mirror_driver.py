"""Connects a mirror to the clock: its only part that uses the event loop."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any

from gateway.clock.lazy_timer import LazyTimer
from gateway.events import Emit, PartFailed
from gateway.images.mirror import Mirror
from gateway.images.polling import MirroredDevice
from gateway.images.polls import MirrorSettings
from gateway.request import Caller, Request
from gateway.trace.ring import Ring


class MirrorDriver:
    """A Target that passes requests and time to its `mirror`, and the Origin of the mirror's polls.

    An unexpected error is contained here: it is logged, its request fails, and polling goes on.
    """

    def __init__(
        self,
        settings: MirrorSettings,
        device: MirroredDevice,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        self.device = device
        self.name = settings.name
        self.mirror = Mirror(settings, device, self, emit, ring)
        self.caller = Caller.without_address(f"mirror {settings.name}")
        self._emit = emit
        self._time = loop.time
        self._timer = LazyTimer(loop, self._wake)
        self._is_open = False
        self._successors: tuple[MirrorDriver, ...] = ()

    def start(self) -> None:
        """Start polling."""
        self._is_open = True
        self._timer.set(self.mirror.deadline())

    def close(self, successors: Iterable["MirrorDriver"] = ()) -> None:
        """Stop polling. Waiting polls are not sent, and reads that wait for one fail.

        `successors` mirror the same device after a reload: writes that are under way here change their values too.
        """
        self._is_open = False
        self._successors = tuple(successors)
        self._timer.close()
        self._run(self.mirror.close, self._time())

    def submit(self, request: Request, now: float) -> None:
        """Take a client's request."""
        if not self._run(self.mirror.submit, request, now):
            self._run(self.mirror.abandon, request)

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - the same for every poll
        """Tell whether waiting polls should be sent."""
        return self._is_open

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to a poll."""
        self._run(self.mirror.polled, request, pdu, self._time())

    def passed(self, request: Request, response: bytes | None) -> None:
        """Take the response to a request that was passed on to the device."""
        self.wrote(request, response)
        self._run(self.mirror.passed, request, response, self._time())

    def wrote(self, request: Request, response: bytes | None) -> None:
        """Take the response to a request passed on by this mirror or an earlier one, before its client gets it."""
        for successor in self._successors:
            successor.wrote(request, response)
        self._run(self.mirror.wrote, request, response, self._time())

    def _wake(self) -> None:
        self._run(self.mirror.tick, self._time())

    def _run(self, step: Callable[..., None], *arguments: Any) -> bool:
        """Run a step. Return False if it raised an unexpected error."""
        is_sound = True
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - the error boundary of a mirror: a defect in it must not reach its line
            self._emit(PartFailed.of(self.caller.client, error))
            is_sound = False
        if self._is_open:
            self._timer.set(self.mirror.deadline())
        return is_sound
