"""Readings that wait to be sent, the oldest first: what of them is in memory, and where the file goes on."""

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from heapq import merge
from typing import Final

from gateway.plant.kept.records import Chunk, Found, Written
from gateway.plant.messages import Readings, Record
from gateway.timing.clock_setting import ClockSetting

#: The most values in memory that are not in the file; the oldest are given up for further ones.
MOST_IN_MEMORY: Final = 50_000
#: From so many values on the file is written before its time.
MANY: Final = 10_000
#: The file is loaded while fewer records than this wait to be sent.
_MOST_LOADED: Final = 5_000
#: A chunk gets no further records from so many values on: it is packed in one go.
_LARGE: Final = 500
#: About how many bytes a value needs in a message beside its name and its text, and a record beside its values.
_VALUE_BYTES: Final = 30
_RECORD_BYTES: Final = 60


@dataclass(slots=True)
class Batch:
    """Records of a device for one message, and how many of each chunk they are."""

    device: str
    records: list[Record] = field(default_factory=list)
    parts: dict[Chunk, int] = field(default_factory=dict)


class Backlog:
    """Chunks in memory that are not in the file, the chunks that are sent next, and the numbers of those sent.

    Chunks of the file are older than those that are not in it, and are sent before.
    """

    def __init__(self, clock: Callable[[], ClockSetting]) -> None:
        #: Values that were never sent.
        self.given_up = 0
        #: Values that are in the file, those that are not, and how many of these came since it was written.
        self.in_file = self.in_memory = self.fresh = 0
        #: The greatest number in the file, and that up to which it was loaded.
        self.file_end = self.loaded_to = 0
        self._clock = clock
        self._setting = clock()
        self._open: dict[str, Chunk] = {}
        self._closed: deque[Chunk] = deque()
        self._next: dict[str, deque[tuple[Chunk, Record]]] = {}
        #: The devices whose chunks were left out, because they must not be told now.
        self._left_out: set[str] = set()
        #: What was taken, and neither confirmed nor refused.
        self._taken: dict[Chunk, int] = {}
        #: What the broker may have already.
        self._held: list[Chunk] = []
        self._gone: set[int] = set()
        #: Chunks of the file that are told in part.
        self._partly: dict[int, Chunk] = {}

    @property
    def since(self) -> float | None:
        """The time of the oldest record that is not in the file; None if there is none."""
        return min((chunk.at for chunk in (*self._closed, *self._open.values()) if not chunk.is_over), default=None)

    @property
    def must_load(self) -> bool:
        """Whether the file has more to send, and memory has room for it."""
        return self.loaded_to < self.file_end and sum(map(len, self._next.values())) < _MOST_LOADED

    def keep(self, device: str, readings: Readings) -> None:
        """Add readings of a device."""
        self._look_at_clock()
        chunk = self._open.get(device)
        if chunk is None:
            chunk = self._open[device] = Chunk(device, self._setting)
        chunk.add(readings)
        if chunk.readings >= _LARGE:
            self._put_away(self._open.pop(device))
        self._count(readings)

    def hold(self, device: str, readings: Readings) -> Chunk:
        """Add readings that the broker may have; neither they nor later ones of the device are sent before `let_go`."""
        self._look_at_clock()
        if device in self._open:
            self._put_away(self._open.pop(device))
        chunk = Chunk(device, self._setting)
        chunk.add(readings)
        self._held.append(chunk)
        self._put_away(chunk)
        self._count(readings)
        return chunk

    def let_go(self, chunk: Chunk) -> None:
        """Hold a chunk no longer. If it is to be sent, `rewind` must follow."""
        self._held.remove(chunk)

    def changes(self) -> tuple[list[Chunk], set[int]]:
        """Return what the file does not have, and the numbers that it has no longer to keep."""
        self._close()
        self._closed = deque(chunk for chunk in self._closed if not chunk.is_over)
        return list(self._closed), set(self._gone)

    def rests(self) -> list[Chunk]:
        """Return what is left of the chunks that are told in part, as it is to be in the file at the end."""
        for chunk in self._closed:
            chunk.shorten()
        for chunk in self._partly.values():
            chunk.shorten()
        return list(self._partly.values())

    def opened(self, readings: int, end: int) -> None:
        """Note that the file was opened: it has so many readings, with numbers up to `end`."""
        self.in_file, self.file_end = readings, end
        if not self._taken:  # the file has what is older
            self.rewind()

    def lost_file(self) -> None:
        """Note that the file is damaged and gone: what was loaded of it is in memory again."""
        saved = [chunk for chunk in dict.fromkeys(self._in_use()) if chunk.number is not None]
        self._take_back(saved)
        self.given_up += self.in_file
        self.in_file = self.file_end = self.loaded_to = 0
        self._gone.clear()
        self._partly.clear()

    def written(self, done: Written) -> None:
        """Note what the file has taken, with which numbers, and what it has given up."""
        self._gone -= done.gone
        for chunk, number in done.chunks:
            if chunk.number == number:  # the rest of one
                continue
            is_passed = chunk.is_loaded or chunk.is_over or chunk in self._held
            if is_passed and self.loaded_to == self.file_end:
                self.loaded_to = number
            chunk.number = self.file_end = number
            if chunk.is_over:
                self._gone.add(number)
                continue
            self.in_memory -= chunk.readings
            self.in_file += chunk.readings
            if chunk.told:
                self._partly[number] = chunk
        taken = {chunk for chunk, _ in done.chunks}
        self._closed = deque(chunk for chunk in self._closed if chunk not in taken)
        if done.given_up:
            self._file_has_given_up(done.given_up)

    def load(self, found: Found, after: int) -> None:
        """Take the chunks of the file that were found to be sent next, if it was loaded up to `after`."""
        for number, readings in found.damaged.items():
            if number not in self._gone:
                self._gone.add(number)
                self._give_up_in_file(readings)
        if after != self.loaded_to:  # the connection was lost meanwhile
            return
        self.loaded_to = found.end
        known = self._gone | {chunk.number for chunk in self._in_use()}
        for chunk in found.chunks:
            if chunk.number in known:
                continue
            before = None if chunk.number is None else self._partly.get(chunk.number)
            self._put_next(chunk if before is None else before)

    def take(self, may_tell: Callable[[str], bool], room: int) -> Batch | None:
        """Return the next records of a device that `may_tell` allows, some `room` bytes; None if none are in memory."""
        if any(map(may_tell, self._left_out)):
            self.rewind()
        if self.loaded_to == self.file_end:
            self._close()
            for chunk in self._closed:
                if not (chunk.is_loaded or chunk.is_over or chunk in self._held):
                    self._put_next(chunk)
        for device in [device for device in self._next if not may_tell(device)]:
            self._left_out.add(device)
            del self._next[device]
        held = {chunk.device for chunk in self._held}
        for device in [device for device in self._next if device not in held]:
            batch = self._batch(device, room)
            if batch.records:
                self._taken = batch.parts
                return batch
        return None

    def sent(self, batch: Batch) -> None:
        """Forget what this batch has told."""
        if batch.parts is self._taken:
            self._taken = {}
        for chunk, count in batch.parts.items():
            values = chunk.tell(count)
            number = chunk.number
            if number is None:
                self.in_memory -= values
                continue
            self.in_file = max(0, self.in_file - values)
            if chunk.is_over:
                self._gone.add(number)
                self._partly.pop(number, None)
            else:
                self._partly[number] = chunk

    def rewind(self) -> None:
        """Begin again with the oldest that was not told: the connection is lost."""
        self._next.clear()
        self._left_out.clear()
        self._taken = {}
        self.loaded_to = 0
        for chunk in self._closed:
            chunk.is_loaded = False

    def _batch(self, device: str, room: int) -> Batch:
        waiting, batch, now = self._next.pop(device), Batch(device), self._clock()
        while waiting and (room > 0 or not batch.records):
            chunk, record = waiting.popleft()
            if chunk.is_over:  # given up meanwhile
                continue
            room -= _size(record)
            batch.records.append(chunk.as_sent(record, now))
            batch.parts[chunk] = batch.parts.get(chunk, 0) + 1
        if waiting:  # the other devices first
            self._next[device] = waiting
        return batch

    def _put_next(self, chunk: Chunk) -> None:
        """Let a chunk be sent next. What waited longest to be published may be kept after what is newer."""
        chunk.is_loaded = True
        waiting = self._next.setdefault(chunk.device, deque())
        records = [(chunk, record) for record in chunk.records[chunk.told :]]
        if waiting and waiting[-1][0].clock == chunk.clock and waiting[-1][1].at > chunk.at:
            self._next[chunk.device] = deque(merge(waiting, records, key=lambda each: each[1].at))
        else:
            waiting.extend(records)

    def _look_at_clock(self) -> None:
        setting = self._clock()
        if setting.is_set != self._setting.is_set or setting.has_stepped(self._setting):
            self._close()
            self._setting = setting

    def _count(self, readings: Readings) -> None:
        self.in_memory += len(readings)
        self.fresh += len(readings)
        self._give_up_oldest()

    def _in_use(self) -> Iterator[Chunk]:
        """Yield the chunks that are to be sent next, are under way, or are held; some often."""
        yield from (chunk for waiting in self._next.values() for chunk, _ in waiting)
        yield from self._taken
        yield from self._held

    def _close(self) -> None:
        for chunk in self._open.values():
            self._put_away(chunk)
        self._open.clear()

    def _put_away(self, chunk: Chunk) -> None:
        chunk.sort()
        self._closed.append(chunk)

    def _give_up_oldest(self) -> None:
        while self.in_memory > MOST_IN_MEMORY:
            if not self._closed:
                self._close()
            if self._closed[0] in self._taken or self._closed[0] in self._held:  # soon over
                return
            chunk = self._closed.popleft()
            if not chunk.is_over:
                chunk.is_over = True
                self.in_memory -= chunk.readings
                self.given_up += chunk.readings

    def _file_has_given_up(self, rows: Iterable[tuple[int, int]]) -> None:
        """Give up rows of the file, but not what is under way, which is in memory again."""
        loaded = {chunk.number: chunk for waiting in self._next.values() for chunk, _ in waiting}
        under_way = {chunk.number: chunk for chunk in (*self._taken, *self._held)}
        for number, readings in rows:
            if number in self._gone:
                self._gone.discard(number)
            elif number in under_way:
                self._take_back([under_way[number]])
            else:
                chunk = loaded.get(number) or self._partly.get(number)
                if chunk is not None:
                    chunk.is_over = True
                self._give_up_in_file(readings if chunk is None else chunk.readings)
            self._partly.pop(number, None)

    def _give_up_in_file(self, readings: int) -> None:
        self.in_file = max(0, self.in_file - readings)
        self.given_up += readings

    def _take_back(self, chunks: list[Chunk]) -> None:
        """Have chunks of the file in memory again."""
        for chunk in chunks:
            chunk.number = None
            self.in_file = max(0, self.in_file - chunk.readings)
            self.in_memory += chunk.readings
        self._closed.extendleft(reversed(chunks))


def _size(record: Record) -> int:
    texts = [*record.values, *(value for value in record.values.values() if isinstance(value, str))]
    return _RECORD_BYTES + _VALUE_BYTES * len(record.values) + sum(map(_size_of_text, texts))


def _size_of_text(text: str) -> int:
    """Return about how many bytes a text takes in JSON: a control character has six, a quote two."""
    return len(text) if text.isalnum() and text.isascii() else len(json.dumps(text))
