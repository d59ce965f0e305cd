"""An image whose writes outlive the gateway: a client has the answer to its write once the write is kept.

A write takes effect at once. It is answered when whoever keeps it says so, and what its client asked meanwhile is
answered behind it. If it cannot be kept, everything since the last write that was kept is undone: those writes get
exception 04, and what their clients have read since is read again.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from gateway.errors import RequestError, ServerDeviceFailure
from gateway.events import Emit, tell_nobody
from gateway.images.image import Image, ImageSettings
from gateway.images.tables import Table, Values
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
#: Keeps a change, and calls `Done` once, sooner or later or at once.
Commit = Callable[[Change, Done], None]


@dataclass(slots=True, eq=False)
class _Waiting:
    """A request that has not been answered yet; `outcome` is what it gets when all goes well."""

    request: Request
    outcome: bytes | RequestError


@dataclass(slots=True, eq=False)
class _Write(_Waiting):
    """A write that has taken effect and is not kept yet; `before` are the values that it replaced."""

    table: Table
    start: int
    before: tuple[int, ...]

    def undo(self) -> None:
        self.table.assign(self.start, self.before)


class PersistentImage(Image):
    """An image that gives each change to `commit`, and answers the write when that has kept it.

    `kept` are the values of earlier runs, by area. They replace the initial ones; those at addresses that the image
    does not have any more are passed over.
    """

    def __init__(
        self, settings: ImageSettings, kept: Iterable[tuple[Area, Values]], commit: Commit, emit: Emit = tell_nobody
    ) -> None:
        super().__init__(settings, emit)
        self._commit = commit
        self._waiting: deque[_Waiting] = deque()
        for area, (start, values) in kept:
            self._restore(self.tables[area], start, values)

    def submit(self, request: Request, now: float) -> None:  # noqa: ARG002 - an image acts at once, whenever that is
        """Act on `request`, and answer it as soon as all that its client wrote before is kept."""
        self._begin(request)
        self._act(request)

    def values(self) -> Iterator[tuple[Area, Values]]:
        """All that it holds, with what is not kept yet."""
        for area, table in self.tables.items():
            for first, last in table.ranges:
                yield area, (first, table.values(first, last + 1 - first))

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
        table = self.tables[span.area]
        before = table.values(span.start, span.count)
        write = _Write(request, act(), table, span.start, before)
        self._waiting.append(write)
        change = Change(self.settings.name, span.area, span.start, table.values(span.start, span.count))
        self._commit(change, partial(self._committed, write))

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
        for write in reversed(undone):
            if isinstance(write, _Write):
                write.undo()
        for waiting in undone:
            if isinstance(waiting, _Write):
                waiting.outcome = ServerDeviceFailure(f"{self.settings.name}: the write could not be kept")
                self._finish(waiting.request, waiting.outcome)
            else:
                self._act(waiting.request)

    def _restore(self, table: Table, start: int, values: Iterable[int]) -> None:
        for address, value in enumerate(values, start):
            if table.has(Span(table.area, address, 1)):
                table.assign(address, (value,))
