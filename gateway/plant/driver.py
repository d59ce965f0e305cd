"""Connects a publisher to the clock and the event loop."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gateway.clock.lazy_timer import LazyTimer
from gateway.events import Emit, PartFailed
from gateway.plant.commands import CALLER, CLIENT, CarriedOut
from gateway.plant.messages import Command, Delivery, Form, Message
from gateway.plant.polls import PolledTarget
from gateway.plant.publisher import Publisher, PublisherSettings
from gateway.request import Request, Target


class PublisherDriver:
    """Hands time, responses and deliveries to its `publisher`. It is the Origin of the publisher's reads.

    `wake` is set when there is something to publish. `unix` returns the present Unix time. An unexpected error ends
    here: it is logged, and reading goes on.
    """

    caller = CALLER

    def __init__(
        self,
        settings: PublisherSettings,
        form: Form,
        targets: Mapping[str, PolledTarget],
        writes_to: Target,
        emit: Emit,
        unix: Callable[[], float],
        carried_out: CarriedOut,
    ) -> None:
        loop = asyncio.get_running_loop()
        self.wake = asyncio.Event()
        self.now = loop.time
        self._emit = emit
        self._is_open = False
        self.publisher = Publisher(
            settings,
            form,
            targets,
            writes_to,
            self,
            emit,
            loop.time,
            lambda now: unix() - loop.time() + now,
            carried_out,
        )
        self._timer = LazyTimer(loop, self._tick)

    def start(self) -> None:
        """Begin to read."""
        self._is_open = True
        self._timer.set(self.publisher.deadline())

    def close(self) -> None:
        """Read no more, and carry out no more commands; waiting reads are not sent."""
        self._is_open = False
        self.publisher.commands.close()
        self._timer.close()

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - the same for every read
        """Tell whether waiting reads should be sent: from `start` to `close`."""
        return self._is_open

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to a read."""
        self._run(self.publisher.answered, request, pdu, self.now())

    def written(self, command: Command, request: Request, response: bytes | None) -> None:
        """Take the response to a command's write."""
        self._run(self.publisher.written, command, request, response, self.now())

    def received(self, delivery: Delivery) -> None:
        """Take a message that the broker has delivered."""
        self._run(self.publisher.received, delivery, self.now())

    def take(self) -> Sequence[Message]:
        """Return the next messages to publish; none if there are none at present."""
        return self.publisher.take(self.now())

    def _tick(self) -> None:
        self._run(self.publisher.tick, self.now())

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - the error boundary of the publisher: a defect must not reach a line
            self._emit(PartFailed.of(CLIENT, error))
        if self._is_open:
            self._timer.set(self.publisher.deadline())
        if self.publisher.has_messages or self.publisher.must_leave:
            self.wake.set()
