"""Connects a publisher to the polls of devices, the clock and the event loop."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from gateway.clock.lazy_timer import LazyTimer
from gateway.events import Emit, PartFailed
from gateway.images.ordered import may_have_written
from gateway.images.polled_range import PollCounts
from gateway.modbus.pdu import parse_sent
from gateway.plant.commands import CLIENT, CarriedOut
from gateway.plant.device_reader import DeviceReader, Polled
from gateway.plant.kept.history import History
from gateway.plant.messages import Command, Delivery, Form, Message
from gateway.plant.publisher import Publisher, PublisherSettings
from gateway.profiles.point import Point
from gateway.request import Request, Target

#: Clocks that are looked at within so many seconds show the same time, and how often this is tried.
_SAME_TIME: Final = 0.0005
_MOST_LOOKS: Final = 10


class PublisherDriver:
    """Hands time, readings, responses and deliveries to its `publisher`. `polls` read the devices, by their names.

    `wake` is set when there is something to publish. `unix` returns the present Unix time. An unexpected error ends
    here: it is logged, and reading goes on.
    """

    def __init__(
        self,
        settings: PublisherSettings,
        form: Form,
        polls: Mapping[str, Polled],
        writes_to: Target,
        emit: Emit,
        unix: Callable[[], float],
        carried_out: CarriedOut,
        history: History | None = None,
    ) -> None:
        loop = asyncio.get_running_loop()
        self.wake = asyncio.Event()
        self.now = loop.time
        #: Requests that have read points.
        self.counts = PollCounts()
        self._emit = emit
        self._is_open = False
        self._polls = polls
        self._readers = {
            device.name: DeviceReader(device, settings.source, self.counts, self) for device in settings.devices
        }
        self.publisher = Publisher(
            settings,
            form,
            writes_to,
            self.written,
            emit,
            loop.time,
            lambda now: now + _ahead(unix, loop.time),
            carried_out,
            history,
        )
        self._timer = LazyTimer(loop, self._tick)

    def start(self) -> None:
        """Begin to read."""
        self._is_open = True
        for name, reader in self._readers.items():
            self._polls[name].change(come=reader.parts)

    def close(self) -> None:
        """Read no more, and carry out no more commands."""
        self.publisher.commands.close()
        self._timer.close()
        if self._is_open:
            self._is_open = False
            for name, reader in self._readers.items():
                self._polls[name].change(gone=reader.parts)

    def took(self, device: str, items: Sequence[tuple[Point, bytes]], now: float) -> None:
        """Take the items of points that one request has read."""
        self._run(self.publisher.took, device, items, now)

    def missed(self, device: str, now: float, *, answers: bool | None) -> None:
        """Note that a request has read nothing."""
        self._run(self.publisher.missed, device, now, answers=answers)

    def written(self, command: Command, request: Request, response: bytes | None) -> None:
        """Take the response to a command's request. After a write its device is polled again at once."""
        if may_have_written(request.pdu, response):
            self._polls[command.device.name].wrote(parse_sent(request.pdu).write)
        self._run(self.publisher.commands.written, command, request, response, self.now())

    def received(self, delivery: Delivery) -> None:
        """Take a message that the broker has delivered."""
        self._run(self.publisher.received, delivery, self.now())

    def begin_history(self, largest: int) -> None:
        """Begin to publish kept readings, in messages of at most `largest` bytes: the broker has the birth."""
        self._run(self.publisher.begin_history, self.now(), largest)

    def look(self) -> None:
        """Look again for kept readings to publish."""
        if self.publisher.history is not None:
            self._run(self.publisher.history.look)

    def hold_slow(self) -> None:
        """Keep the new readings for which the broker takes long."""
        if self.publisher.history is not None:
            self._run(self.publisher.history.hold_slow, self.now())

    def confirmed(self, message: Message) -> None:
        """Note that the broker has a message."""
        self._run(self.publisher.confirmed, message, self.now())

    def refused(self, message: Message, *, is_passing: bool) -> None:
        """Note that the broker has refused a message, for now or for ever."""
        self._run(self.publisher.refused, message, self.now(), is_passing=is_passing)

    def take(self) -> Sequence[Message]:
        """Return the next messages to publish; none if there are none at present."""
        return self.publisher.take(self.now())

    def _tick(self) -> None:
        self._run(self.publisher.tick, self.now())

    def _run(self, step: Callable[..., None], *arguments: Any, **options: Any) -> None:
        try:
            step(*arguments, **options)
        except Exception as error:  # noqa: BLE001 - the error boundary of the publisher: a defect must not reach a line
            self._emit(PartFailed.of(CLIENT, error))
        publisher, now = self.publisher, self.now()
        if self._is_open:
            self._timer.set(publisher.deadline(now))
        if publisher.has_messages or publisher.must_leave or publisher.has_history(now):
            self.wake.set()


def _ahead(unix: Callable[[], float], time: Callable[[], float]) -> float:
    """Return how far Unix times are ahead of another clock.

    Another thread may run between two looks at clocks: then they are looked at again.
    """
    for _ in range(_MOST_LOOKS):
        before, at, after = time(), unix(), time()
        if after - before < _SAME_TIME:
            break
    return at - after
