"""Writes kept readings to their file from time to time, and reads them again when they are to be sent."""

import asyncio
import sqlite3
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway.clock.setting import clock_setting
from gateway.clock.threads import in_thread
from gateway.clock.times import rfc_3339
from gateway.config.values.duration import show_size
from gateway.errors import StateError
from gateway.events import Emit, PartFailed, StateDamaged
from gateway.plant.kept.backlog import MANY, MOST_IN_MEMORY, Backlog, Batch
from gateway.plant.kept.file import KeptFile
from gateway.plant.kept.given_up import GivenUp
from gateway.plant.kept.progress import Progress
from gateway.plant.kept.records import Chunk, Totals, Written
from gateway.plant.messages import Readings
from gateway.plant.status import KeptStatus
from gateway.state.database import is_damage
from gateway.state.file_trouble import FileTrouble
from gateway.timing.clock_setting import ClockSetting

FILE_NAME: Final = "mqtt-kept.sqlite"
_THREAD: Final = "kept readings"
#: How long the disk may take at the end, in seconds.
CLOSING_DEADLINE: Final = 1.0


class Keeper:
    """Keeps readings in `folder`, at most `most` bytes, written every `every` seconds; without a folder in memory only.

    `ready` is called when there is something to send again, `before_write` when the file is about to be written.
    """

    def __init__(
        self,
        folder: Path | None,
        most: int,
        every: float,
        emit: Emit,
        clock: Callable[[], ClockSetting] = clock_setting,
        unix: Callable[[], float] = time.time,
    ) -> None:
        self.most, self.every = most, every
        self.ready: Callable[[], None] = lambda: None
        self.before_write: Callable[[], None] = lambda: None
        self._path = None if folder is None else folder / FILE_NAME
        self._emit = emit
        self._unix = unix
        self._backlog = Backlog(clock)
        self._file: KeptFile | None = None
        self._totals = Totals()
        now = asyncio.get_running_loop().time
        self._given_up = GivenUp(emit, now)
        self._progress = Progress(emit, now)
        self._counted = 0
        self._trouble = FileTrouble(self._path, emit)
        self._must_load = self._is_closing = False
        self._wake = asyncio.Event()
        self._task = asyncio.create_task(self._run(), name="kept readings")

    @property
    def status(self) -> KeptStatus:
        """How much is kept, and since when."""
        backlog, totals = self._backlog, self._totals
        values, full_in, given_up_ago = self._values, None, self._given_up.age
        if self._file is not None:
            full_in = self._progress.full_in(totals.size, self._file.room)
        times = [each for each in (totals.since if backlog.in_file else None, backlog.since) if each is not None]
        since = min(times, default=None)
        return KeptStatus(
            values=values,
            since=None if since is None else rfc_3339(since),
            age_ms=None if since is None else 1000 * max(0.0, self._unix() - since),
            bytes=totals.size,
            limit=self.most,
            full_in_ms=None if full_in is None else 1000 * full_in,
            given_up=self._given_up.values,
            given_up_ms=None if given_up_ago is None else 1000 * given_up_ago,
            trouble=self._trouble.reason,
        )

    @property
    def _values(self) -> int:
        return self._backlog.in_file + self._backlog.in_memory

    def keep(self, device: str, readings: Readings) -> None:
        """Keep readings of a device."""
        if not readings:
            return
        self._backlog.keep(device, readings)
        self._count_given_up(f"they could not be written, and {MOST_IN_MEMORY} newer ones are in memory")
        if self._backlog.fresh >= MANY:
            self._wake.set()

    def hold(self, device: str, readings: Readings) -> Chunk:
        """Keep readings that the broker may have, until `let_go`."""
        chunk = self._backlog.hold(device, readings)
        self._count_given_up(f"they could not be written, and {MOST_IN_MEMORY} newer ones are in memory")
        return chunk

    def let_go(self, chunk: Chunk, *, must_send: bool) -> None:
        """Forget what was held; or if the connection was lost, have it sent."""
        self._backlog.let_go(chunk)
        if not must_send:
            self._forget(Batch(chunk.device, parts={chunk: len(chunk.records)}))

    def take(self, may_tell: Callable[[str], bool], room: int) -> Batch | None:
        """Return the next records to send; None if there are none at present: `ready` is called when there are."""
        if self._path is not None and self._file is None and not self._trouble.reason:
            return None  # the file may have older ones
        batch = self._backlog.take(may_tell, room)
        if batch is None and self._backlog.must_load:
            self._must_load = True
            self._wake.set()
        return batch

    def sent(self, batch: Batch) -> None:
        """Forget a batch: it was confirmed."""
        self._progress.sent(_size(batch))
        self._forget(batch)

    def give_up(self, batch: Batch) -> None:
        """Forget a batch that cannot be sent."""
        self._backlog.given_up += _size(batch)
        self._count_given_up("the broker refuses them, or the points are gone")
        self._forget(batch)

    def rewind(self) -> None:
        """Send again what was not confirmed: the connection is lost."""
        self._backlog.rewind()
        self._progress.begin()

    async def close(self) -> None:
        """Write the rest, and close the file. After CLOSING_DEADLINE that goes on without being waited for."""
        self._is_closing = True
        self._wake.set()
        _, hanging = await asyncio.wait([self._task], timeout=CLOSING_DEADLINE)
        if hanging:
            self._trouble.tell("the disk takes too long")
        self._given_up.add(self._backlog.in_memory, "they could not be written at the end")
        self._given_up.tell(is_last=True)

    def _count_given_up(self, why: str) -> None:
        given_up, self._counted = self._backlog.given_up - self._counted, self._backlog.given_up
        self._given_up.add(given_up, why)

    def _forget(self, batch: Batch) -> None:
        self._backlog.sent(batch)
        self._progress.left(self._values)

    async def _run(self) -> None:
        """Write every so often, or sooner if there is much, and at the end; load when asked to."""
        loop = asyncio.get_running_loop()
        write_at = loop.time()
        while not self._is_closing:
            if loop.time() >= write_at or self._backlog.fresh >= MANY:
                write_at = loop.time() + self.every
                await self._try(self._write)
            if self._must_load:
                await self._try(self._load)
            self._given_up.tell()
            await self._wait(write_at)
        await self._try(self._write)
        if self._file is not None:
            await in_thread(_THREAD, self._file.close)

    async def _wait(self, until: float) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout_at(until):
                await self._wake.wait()
        self._wake.clear()

    async def _try(self, step: Callable[[], Awaitable[None]]) -> None:
        """Write or load; go on in memory if the disk or file fails. A damaged one is set aside when it is opened."""
        try:
            await step()
        except (StateError, sqlite3.Error) as error:
            if is_damage(error) and self._file is not None:
                await in_thread(_THREAD, self._file.close)
                self._file, self._totals = None, Totals()
                self._backlog.lost_file()
                self._count_given_up("the file was damaged")
            self._trouble.tell(str(error))
            self.ready()  # what is in memory can be sent
        except Exception as error:  # noqa: BLE001 - an error boundary: values are published all the same
            self._emit(PartFailed.of("kept readings", error))

    async def _write(self) -> None:
        self._backlog.fresh = 0
        if not self._is_closing:  # then nothing is in flight any more
            self.before_write()
        if self._path is None:
            return
        file = self._file or await self._open(self._path)
        chunks, gone = self._backlog.changes()
        chunks += self._backlog.rests() if self._is_closing else []
        if chunks or gone:
            done = Written(self._totals)
            try:
                await in_thread(_THREAD, file.write, chunks, gone, done)
            finally:
                self._totals = done.totals
                self._backlog.written(done)
                self._count_given_up(f"{show_size(self.most)} are full: the oldest go first")
                self._progress.written(self._totals.size)
                self._progress.left(self._values)
        self._trouble.tell("")

    async def _open(self, path: Path) -> KeptFile:
        file, damage = await in_thread(_THREAD, KeptFile.open, path, self.most)
        if damage:
            self._emit(StateDamaged(str(path), damage))
        try:
            readings, totals = await in_thread(_THREAD, file.readings), await in_thread(_THREAD, file.totals)
        except sqlite3.Error:
            await in_thread(_THREAD, file.close)  # the next attempt could not open it
            raise
        self._file, self._totals = file, totals
        self._backlog.opened(readings, self._totals.end)
        self.ready()
        return file

    async def _load(self) -> None:
        self._must_load = False
        if self._file is None:
            return
        after = self._backlog.loaded_to
        self._backlog.load(await in_thread(_THREAD, self._file.after, after), after)
        self._count_given_up("the file was damaged")
        self.ready()


def _size(batch: Batch) -> int:
    return sum(len(record.values) for record in batch.records)
