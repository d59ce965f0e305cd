"""An image whose writes outlive the gateway: a client has the answer to its write once the write is kept.

A write takes effect at once. It is answered when whoever keeps it says so, and what its client asked meanwhile is
answered behind it. If it cannot be kept, everything since the last write that was kept is undone: those writes get
exception 04, and what their clients have read since is read again.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

from gateway.errors import RequestError, ServerDeviceFailure
from gateway.events import Emit, discard_event
from gateway.images.image import Image, ImageSettings
from gateway.images.tables import make_tables
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.request import Request


class Change(NamedTuple):
    """New values in an area of the image called `image`, from the address `start` on."""

    image: str
    area: Area
    start: int
    values: tuple[int, ...]


#: Is told whether a change is kept now. Changes are kept in the order in which they were made.
Done = Callable[[bool], None]


class Keeper(Protocol):
    """Keeps the values of images, by the name of the image, area and address."""

    def values(self, image: str) -> Mapping[Area, Mapping[int, int]]:
        """The present values of `image`; what could not be kept is undone before `Done` is told."""

    def keep_at_once(self, change: Change, done: Done) -> None:
        """Keep a change, and tell `done` once it is kept or has failed."""

    def keep_soon(self, change: Change, done: Done) -> None:
        """Keep a change before long; `done` is told at once."""

    def when_kept(self, done: Done) -> None:
        """Tell `done` whether all present values could be kept."""


@dataclass(slots=True, eq=False)
class _Waiting:
    """A request that has not been answered yet; `outcome` is what it gets when all goes well."""

    request: Request
    outcome: bytes | RequestError


class _Write(_Waiting):
    """A write that has taken effect and is not kept yet."""

    __slots__ = ()


class PersistentImage(Image):
    """An image that gives each change to `keeper`, and answers the write when that has kept it.

    From `start` on it has the keeper's values instead of the initial ones; those at addresses that it does not have are
    passed over.
    """

    def __init__(self, settings: ImageSettings, keeper: Keeper, emit: Emit = discard_event) -> None:
        super().__init__(settings, emit)
        self._keeper = keeper
        self._keep = keeper.keep_at_once if settings.persist == "always" else keeper.keep_soon
        self._waiting: deque[_Waiting] = deque()
        self._has_started = False

    def start(self) -> None:
        """Go on with the present values, at the moment from which requests come here."""
        if not self._has_started:
            self._has_started = True
            self._take_over()
            self._keeper.when_kept(self._confirmed)

    def submit(self, request: Request, now: float) -> None:  # noqa: ARG002 - an image acts at once, whenever that is
        """Act on `request`, and answer it as soon as all that its client wrote before is kept."""
        self._begin(request)
        self._act(request)

    def _act(self, request: Request) -> None:
        try:
            asked = self._check(request.pdu)
            if asked.write is not None:
                self._write(request, asked.write, partial(self._perform, asked))
                return
            outcome: bytes | RequestError = self._perform(asked)
        except RequestError as error:
            outcome = error
        waiting = _Waiting(request, outcome)
        client = request.origin.client
        if any(other.request.origin.client == client for other in self._waiting):
            self._waiting.append(waiting)
        else:
            self._finish(waiting.request, waiting.outcome)

    def _write(self, request: Request, span: Span, act: Callable[[], bytes]) -> None:
        write = _Write(request, act())
        self._waiting.append(write)
        values = self.tables[span.area].values(span.start, span.count)
        self._keep(Change(self.settings.name, span.area, span.start, values), partial(self._committed, write))

    def _confirmed(self, is_kept: bool) -> None:  # noqa: FBT001 - the one thing to be told
        if not is_kept:
            self._undo()

    def _committed(self, write: _Write, is_kept: bool) -> None:  # noqa: FBT001 - the one thing to be told
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
        self._finish(waiting.request, waiting.outcome)

    def _undo(self) -> None:
        undone = list(self._waiting)
        self._waiting.clear()
        self._take_over()
        for waiting in undone:
            if isinstance(waiting, _Write):
                waiting.outcome = ServerDeviceFailure(f"{self.settings.name}: the write could not be kept")
                self._finish(waiting.request, waiting.outcome)
            else:
                self._act(waiting.request)

    def _take_over(self) -> None:
        self.tables = make_tables(self.settings.areas, self.settings.initial)
        for area, values in self._keeper.values(self.settings.name).items():
            self.tables[area].replace(values)
