"""Keeps the trends of all points while the gateway runs.

The file is written every ten minutes, soon after a slot has ended, and at a stop: a power cut loses what was heard
since the last write.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

from gateway.clock.threads import ThreadPerCall
from gateway.events import Emit
from gateway.operator.operator import Operator
from gateway.operator.trends.sampler import Sampler
from gateway.operator.trends.table import TABLE, Entry, entry, row_of, write
from gateway.operator.trends.trends import Trends
from gateway.state.database import Database
from gateway.state.row_file import Changes, RowFile, growing
from gateway.timing.trend import Layout, Means, Slot

T = TypeVar("T")

FILE_NAME: Final = "trends.sqlite"
#: The file is written so often, so many seconds after the clock has come to a multiple of it.
WRITE_EVERY: Final = 600
_AFTER: Final = 5
#: How many slots the means of all points have that pages show beside values.
RECENT_SLOTS: Final = 60


class _File(RowFile[Entry]):
    """The file of trends: what is written is joined with what it has of the same blocks, and old blocks are dropped."""

    def __init__(self, file: Path, trends: Trends, pause: Callable[[], float], emit: Emit) -> None:
        read, row = partial(entry, trends.layout), row_of
        super().__init__(file, TABLE, trends, emit, read=read, row=row, pause=pause)
        self._trends = trends

    def put(self, database: Database, changes: Changes[Entry]) -> None:
        """Write pieces, and drop old ones. Blocks.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        write(database, self._trends.layout, changes.written, self._trends.time)


class KeptTrends:
    """The trends of all points: what is in memory, and the file that has the rest, if there is one."""

    def __init__(self, trends: Trends, file: _File | None = None) -> None:
        self.layout = trends.layout
        self._trends = trends
        self._file = file
        self._recent: tuple[int, Mapping[int, Means]] = (0, {})
        self._one_reader_at_a_time = asyncio.Lock()

    def add_past(self, time: float, trend: int, numbers: Sequence[float]) -> None:
        """Add values that were heard of a trend at a `time` before now, in seconds since 1970."""
        self._trends.add_past(time, trend, numbers)

    async def slots(self, trend: int, since: float, until: float) -> list[Slot]:
        """Read the slots of a trend that begin from `since` on and before `until`, in seconds since 1970."""
        return await self._look(partial(self._trends.newest().slots, key=trend, since=since, until=until))

    async def recent(self, now: float) -> Mapping[int, Means]:
        """Read the last RECENT_SLOTS of all trends; this is done once a minute for all who ask."""
        minute, since = int(now // 60), self.layout.slot_at(now) - (RECENT_SLOTS - 1) * self.layout.step
        async with self._one_reader_at_a_time:
            if self._recent[0] != minute:
                look = partial(self._trends.newest().means, since=since, count=RECENT_SLOTS)
                self._recent = minute, await self._look(look)
        return self._recent[1]

    async def _look(self, look: Callable[[Database | None], T]) -> T:
        if self._file is not None:
            return await self._file.look(look)
        return await asyncio.get_running_loop().run_in_executor(ThreadPerCall("trends"), look, None)


class _Place:
    """Where an operator has the trends."""

    trends: KeptTrends | None = None


def kept_trends(operator: Operator) -> KeptTrends | None:
    """Find the trends; None if none are kept."""
    return operator.kept(_Place).trends


@asynccontextmanager
async def trends_kept(operator: Operator, kept: float, folder: Path | None) -> AsyncIterator[None]:
    """Keep trends for so many seconds inside the context; none for 0.

    Without a `folder` only the last ones are there, and they are lost with the process.
    """
    if not kept:
        yield
        return
    trends, emit = Trends(Layout.of(kept)), operator.running.emit
    sampler = Sampler(operator, trends)

    def pause() -> float:
        return _AFTER + WRITE_EVERY - operator.clock() % WRITE_EVERY

    async def finish() -> None:
        await sampler.look()
        trends.end()

    file = None if folder is None else _File(folder / FILE_NAME, trends, pause, emit)
    place = operator.kept(_Place)
    async with growing("trends", sampler.keep_looking, finish, file, emit):
        place.trends = KeptTrends(trends, file)
        try:
            yield
        finally:
            place.trends = None
