"""Readings that wait to be sent, the oldest first: what of them is in memory, and where the file goes on."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.plant.kept.records import Chunk
from gateway.plant.messages import Readings, Record
from gateway.timing.clock_setting import ClockSetting

#: The most values in memory that are not in the file; the oldest are given up for further ones.
MOST_IN_MEMORY: Final = 50_000
#: From so many values on the file is written before its time.
MANY: Final = 10_000
#: The file is loaded while fewer records than this wait to be sent.
MOST_LOADED: Final = 5_000
#: About how many bytes a value needs in a message beside its name and its text, and a record beside its values.
_VALUE_BYTES: Final = 30
_RECORD_BYTES: Final = 60


@dataclass(slots=True)
class Batch:
    """Records of a device for one message; `ends` are the chunks of which these are the last ones."""

    device: str
    records: list[Record] = field(default_factory=list)
    ends: list[Chunk] = field(default_factory=list)


class Backlog:
    """Chunks in memory that are not in the file, the chunks that are sent next, and the numbers of those sent.

    Chunks of the file are older than those that are not in it, and are sent before.
    """

    def __init__(self, clock: Callable[[], ClockSetting]) -> None:
        #: Values that were never sent.
        self.given_up = 0
        #: Values that are not in the file, and how many of these came since it was written.
        self.in_memory = self.fresh = 0
        #: The greatest number in the file, and that up to which it was loaded.
        self.file_end = self.loaded_to = 0
        self._clock = clock
        self._setting = clock()
        self._open: dict[str, Chunk] = {}
        self._closed: deque[Chunk] = deque()
        self._next: dict[str, deque[tuple[Chunk, Record]]] = {}
        #: What the broker may have already.
        self._held: list[Chunk] = []
        self._gone: set[int] = set()

    @property
    def since(self) -> float | None:
        """The time of the oldest record that is not in the file; None if there is none."""
        return min((chunk.at for chunk in (*self._closed, *self._open.values()) if not chunk.is_sent), default=None)

    @property
    def must_load(self) -> bool:
        """Whether the file has more to send, and memory has room for it."""
        return self.loaded_to < self.file_end and sum(map(len, self._next.values())) < MOST_LOADED

    @property
    def has_changes(self) -> bool:
        """Whether the file is to be written."""
        return bool(self._open or self._closed or self._gone)

    def keep(self, device: str, readings: Readings) -> None:
        """Add readings of a device."""
        self._look_at_clock()
        self._open.setdefault(device, Chunk(device, self._setting)).add(readings)
        self._count(readings)

    def hold(self, device: str, readings: Readings) -> Chunk:
        """Add readings that the broker may have; neither they nor later ones of the device are sent before `let_go`."""
        self._look_at_clock()
        if device in self._open:
            self._closed.append(self._open.pop(device))
        chunk = Chunk(device, self._setting)
        chunk.add(readings)
        self._closed.append(chunk)
        self._held.append(chunk)
        self._count(readings)
        return chunk

    def let_go(self, chunk: Chunk) -> None:
        """Hold a chunk no longer. If it is to be sent, `rewind` must follow."""
        self._held.remove(chunk)

    def changes(self) -> tuple[list[Chunk], set[int]]:
        """Return what the file does not have, and the numbers that it has no longer to keep."""
        self._close()
        self._closed = deque(chunk for chunk in self._closed if not chunk.is_sent)
        self.fresh = 0
        return list(self._closed), set(self._gone)

    def written(self, chunks: Sequence[Chunk], gone: set[int]) -> None:
        """Note that the file has taken these changes, and has numbered the chunks."""
        self._gone -= gone
        for chunk in chunks:
            self.file_end = chunk.number or 0
            chunk.is_in_file = True
            self.loaded_to = self.file_end if chunk.is_loaded else self.loaded_to
            if chunk.is_sent:
                self._gone.add(self.file_end)
            else:
                self.in_memory -= chunk.readings
        taken = set(chunks)
        self._closed = deque(chunk for chunk in self._closed if chunk not in taken)

    def load(self, chunks: Iterable[Chunk], after: int, end: int) -> None:
        """Take the chunks of the file between these numbers to be sent next, if it was loaded up to `after`."""
        if after != self.loaded_to:  # the connection was lost meanwhile
            return
        self.loaded_to = end
        held = {chunk.number for chunk in self._held}
        for chunk in chunks:
            chunk.is_in_file = True
            if chunk.number not in self._gone and chunk.number not in held:
                self._put_next(chunk)

    def take(self, may_tell: Callable[[str], bool], room: int) -> Batch | None:
        """Return the next records of a device that `may_tell` allows, some `room` bytes; None if none are in memory."""
        if self.loaded_to == self.file_end:
            self._close()
            for chunk in self._closed:
                if not (chunk.is_loaded or chunk.is_sent or chunk in self._held):
                    self._put_next(chunk)
        held = {chunk.device for chunk in self._held}
        device = next((device for device in self._next if may_tell(device) and device not in held), None)
        return None if device is None else self._batch(device, room)

    def sent(self, batch: Batch) -> int:
        """Forget the chunks that end with this batch; return how many of their values are in the file."""
        in_file = 0
        for chunk in batch.ends:
            if chunk.is_in_file and chunk.number is not None:
                self._gone.add(chunk.number)
                in_file += chunk.readings
            elif not chunk.is_sent:
                self.in_memory -= chunk.readings
            chunk.is_sent = True
        return in_file

    def forget_file(self) -> None:
        """Forget what is in the file, which is damaged. What was loaded is still sent."""
        self.file_end = self.loaded_to = 0
        self._gone.clear()
        for chunk in {chunk for waiting in self._next.values() for chunk, _ in waiting if chunk.is_in_file}:
            chunk.is_in_file, chunk.is_sent = False, True

    def rewind(self) -> None:
        """Begin again with the oldest that was not sent: the connection is lost."""
        self._next.clear()
        self.loaded_to = 0
        for chunk in self._closed:
            chunk.is_loaded = False

    def _batch(self, device: str, room: int) -> Batch:
        waiting, batch, now = self._next.pop(device), Batch(device), self._clock()
        while waiting and (room > 0 or not batch.records):
            chunk, record = waiting.popleft()
            room -= _size(record)
            batch.records.append(chunk.as_sent(record, now))
            if record is chunk.records[-1]:
                batch.ends.append(chunk)
        if waiting:  # the other devices first
            self._next[device] = waiting
        return batch

    def _put_next(self, chunk: Chunk) -> None:
        chunk.is_loaded = True
        self._next.setdefault(chunk.device, deque()).extend((chunk, record) for record in chunk.records)

    def _look_at_clock(self) -> None:
        setting = self._clock()
        if setting.is_set != self._setting.is_set or setting.has_stepped(self._setting):
            self._close()
            self._setting = setting

    def _count(self, readings: Readings) -> None:
        self.in_memory += len(readings)
        self.fresh += len(readings)
        if self.in_memory > MOST_IN_MEMORY:
            self._close()
            self._give_up_oldest()

    def _close(self) -> None:
        self._closed.extend(self._open.values())
        self._open.clear()

    def _give_up_oldest(self) -> None:
        while self._closed and self.in_memory > MOST_IN_MEMORY:
            chunk = self._closed.popleft()
            if not chunk.is_sent:
                chunk.is_sent = True
                self.in_memory -= chunk.readings
                self.given_up += chunk.readings


def _size(record: Record) -> int:
    texts = sum(len(str(value)) if isinstance(value, str) else 0 for value in record.values.values())
    return _RECORD_BYTES + sum(len(name) + _VALUE_BYTES for name in record.values) + texts
