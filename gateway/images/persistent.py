"""An image whose writes survive a restart: a write is acknowledged after it was saved.

A write takes effect at once and is acknowledged when the store has saved it; later requests of its client are answered
after that. If it cannot be saved, all writes since the last saved one are undone and get exception 04, and later reads
of these clients are executed again.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

from gateway.errors import DeviceFailure, RequestError
from gateway.events import Emit, discard_event
from gateway.images.image import Image, ImageSettings
from gateway.images.tables import make_tables
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.request import Request
from gateway.trace.ring import Ring


class Change(NamedTuple):
    """New values in an area of the image named `image`, from the address `start` on."""

    image: str
    area: Area
    start: int
    values: tuple[int, ...]


#: Called with True if a change was saved, else False. Changes are saved in the order in which they were made.
Done = Callable[[bool], None]


class ValueStore(Protocol):
    """Saves the values of images by name of the image, area and address."""

    @property
    def is_open(self) -> bool:
        """Whether the saved values are known."""

    def values(self, image: str) -> Mapping[Area, Mapping[int, int]]:
        """Return the present values of `image`; failed changes are undone before `Done` is called."""

    def keep_at_once(self, change: Change, done: Done) -> None:
        """Save a change; call `done` when it was saved or has failed."""

    def keep_soon(self, change: Change, done: Done) -> None:
        """Save a change within a second; call `done` at once."""

    def when_kept(self, done: Done) -> None:
        """Call `done` with True if all present values could be saved, else False."""


@dataclass(slots=True, eq=False)
class _Waiting:
    """A request that is not answered yet; `outcome` is its answer if its writes can be saved."""

    request: Request
    outcome: bytes | RequestError


class _Write(_Waiting):
    """A write that has taken effect and is not saved yet."""

    __slots__ = ()


class PersistentImage(Image):
    """An image that passes each change to `store`, and acknowledges the write when it was saved.

    From `start` on it has the store's values instead of the initial ones; values at addresses that it does not have are
    ignored. Until then all requests get 04.
    """

    def __init__(
        self, settings: ImageSettings, store: ValueStore, emit: Emit = discard_event, ring: Ring | None = None
    ) -> None:
        super().__init__(settings, emit, ring)
        self._store = store
        self._keep = store.keep_at_once if settings.persist == "always" else store.keep_soon
        self._waiting: deque[_Waiting] = deque()
        self.has_started = False

    def start(self) -> None:
        """Load the present values, once they can be read. Called whenever routes have changed."""
        if not self.has_started and self._store.is_open:
            self.has_started = True
            self._take_over()
            self._store.when_kept(self._confirmed)

    def submit(self, request: Request, now: float) -> None:  # noqa: ARG002 - an image answers at once
        """Execute `request`, and answer it when all earlier writes of its client are saved."""
        self._begin(request)
        self._act(request)

    def _act(self, request: Request) -> None:
        try:
            asked = self._check(request)
            if not self.has_started:
                raise DeviceFailure(f"{self.settings.name}: what was saved cannot be read")
            if asked.write is not None:
                self._write(request, asked.write, partial(self._perform, asked))
                return
            outcome: bytes | RequestError = self._perform(asked)
        except RequestError as error:
            outcome = error
        waiting = _Waiting(request, outcome)
        client = request.caller.client
        if any(other.request.caller.client == client for other in self._waiting):
            self._waiting.append(waiting)
        else:
            self._finish(waiting.request, waiting.outcome, waiting.request.received_at)

    def _write(self, request: Request, span: Span, act: Callable[[], bytes]) -> None:
        write = _Write(request, act())
        self._waiting.append(write)
        values = self.tables[span.area].values(span.start, span.count)
        self._keep(Change(self.settings.name, span.area, span.start, values), partial(self._committed, write))

    def _confirmed(self, is_kept: bool) -> None:  # noqa: FBT001 - the only argument of a callback
        if not is_kept:
            self._undo()

    def _committed(self, write: _Write, is_kept: bool) -> None:  # noqa: FBT001 - the only argument of a callback
        if write not in self._waiting:  # undone together with an earlier one
            return
        if not is_kept:
            self._undo()
            return
        self._finish_next()
        while self._waiting and not isinstance(self._waiting[0], _Write):
            self._finish_next()

    def _finish_next(self) -> None:
        waiting = self._waiting.popleft()
        self._finish(waiting.request, waiting.outcome, waiting.request.received_at)

    def _undo(self) -> None:
        undone = list(self._waiting)
        self._waiting.clear()
        self._take_over()
        for waiting in undone:
            if isinstance(waiting, _Write):
                waiting.outcome = DeviceFailure(f"{self.settings.name}: the write could not be saved")
                self._finish(waiting.request, waiting.outcome, waiting.request.received_at)
            else:
                self._act(waiting.request)

    def _take_over(self) -> None:
        self.tables = make_tables(self.settings.areas, self.settings.initial)
        for area, values in self._store.values(self.settings.name).items():
            self.tables[area].replace(values)
