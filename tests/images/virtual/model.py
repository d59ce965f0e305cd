"""What clients of a virtual unit get, by a model in a few lines, beside the unit itself.

The model knows what each device has said to a row, and which writes had finished when it was asked. It does not know
how polls are joined, how values are kept and converted, or what is remembered of reads.
"""

from dataclasses import dataclass
from typing import Any

from gateway.images.polls import Poll
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.request import Request
from images.virtual.bench import Bench
from soak.maps.conversion import Encoding, turned

STALE = 2.0
#: Each source of a device has so many registers: rows of a device are of other registers, or of the same.
SIZE, SOURCES = 4, 5
BITS_AT, AGES_AT = 200, 210
#: Exceptions after which a device has not written.
WITHOUT_EFFECT = (1, 2, 3, 6, 10)


@dataclass(frozen=True)
class Row:
    """A row at `at`, of a source of a device: all of its registers, or a value there that is encoded as `target`."""

    at: int
    device: str
    source: int
    here: Encoding | None = None
    target: Encoding | None = None
    swap: str = "none"
    write: bool = False
    when_stale: Any = "exception"

    @property
    def first(self) -> int:
        return SIZE * self.source

    @property
    def taken(self) -> int:
        return SIZE if self.here is None else self.here.count

    @property
    def count(self) -> int:
        return SIZE if self.here is None else (self.target or self.here).count

    @property
    def end(self) -> int:
        return self.at + self.count

    def shown(self, registers) -> tuple[int, ...] | None:
        """What it shows of the registers of its source; None if they have no value, or it does not fit."""
        if self.here is None:
            pairs = [turned(registers[at : at + 2], self.swap) for at in range(0, SIZE, 2)]
            return tuple(registers) if self.swap == "none" else tuple(word for pair in pairs for word in pair)
        value = self.here.value(registers[: self.taken])
        if value is None or self.target is None:
            return None if value is None else tuple(registers[: self.taken])
        return self.target.words(value)

    @property
    def mapped(self) -> MappedValue:
        """As the gateway has it."""
        poll = Poll(Area.HOLDING, self.first, self.first + self.taken - 1, 1.0)
        place = Span(Area.HOLDING, self.at, self.count)
        point = None if self.here is None else _point(self.here, self.first)
        target = None if self.target is None else _point(self.target, self.at)
        return MappedValue(place, self.device, poll, point, target, self.swap, self.write, self.when_stale)


def _point(how: Encoding, at: int) -> Point:
    scale, offset = float(how.scale), float(how.offset)
    return Point("value", Area.HOLDING, at, how.type, how.swap, how.count, scale, offset=offset, write="yes")


@dataclass
class Known:
    """What a device said last to a row: when it was asked, after how many finished writes; and the last valid value.

    `changed_by` is the number of the last write that may have changed it.
    """

    said: tuple[int, ...] | None = None
    at: float = 0.0
    after: int = 0
    changed_by: int = 0
    held: tuple[int, ...] | None = None


@dataclass(eq=False)
class Asked:
    """A client's open request for `count` registers, and how many writes had finished then.

    A write has its row, and what is to be sent.
    """

    first: int
    count: int
    writes: dict[str, int]
    row: Row | None = None
    sent: bytes = b""


class Model:
    """A virtual unit with these rows, its devices, two clients, and what they must get."""

    def __init__(self, devices: tuple[str, ...], rows: tuple[Row, ...]) -> None:
        anchors = [Row(SIZE * at, name, 0) for at, name in enumerate(devices)]
        self.bench = Bench(*(row.mapped for row in anchors), stale=STALE)
        self.registers = {name: [0] * SIZE * SOURCES for name in devices}
        self.rows: tuple[Row, ...] = ()
        self.open: dict[str, Asked] = {}
        self.clients = {name: self.bench.client(name) for name in ("one", "other")}
        self._writes = dict.fromkeys(devices, 0)
        self._known: dict[Row, Known] = {}
        #: When each poll was sent, and after how many finished writes.
        self._polls: dict[Request, tuple[float, int]] = {}
        self.reload(rows)

    # --- what happens ---

    def reload(self, rows: tuple[Row, ...]) -> None:
        """Replace the rows; those that both have keep their values. Nothing is under way."""
        self.fail_everything()
        self.rows, self._known = rows, {row: self._known.get(row, Known()) for row in rows}
        self.names = tuple(dict.fromkeys(row.device for row in rows))
        fresh = (FreshBits(Span(Area.HOLDING, BITS_AT, 1), self.names),)
        ages = tuple(SourceAge(Span(Area.HOLDING, AGES_AT + at, 1), name) for at, name in enumerate(self.names))
        self.bench.reload(self.bench.made(*(row.mapped for row in rows), stale=STALE, fresh=fresh, ages=ages))
        self.time_passes(0.0)

    def time_passes(self, seconds: float) -> None:
        """Let time pass; polls that are due are sent."""
        self.bench.now += seconds
        for name, device in self.bench.devices.items():
            self.bench.poll(device)
            for request in device.asked:
                if request.origin is device and request not in self._polls:
                    self._polls[request] = self.bench.now, self._writes[name]
        self.look()

    def fail_everything(self) -> None:
        """Let all devices fail to answer what they were asked, until nothing is asked."""
        for name, device in self.bench.devices.items():
            while device.asked:
                self.answer(name, 0, 11)

    def answer(self, name: str, which: int, failure: int | None) -> None:
        """A device answers one of the requests that it was sent, perhaps with an exception."""
        request = self.bench.devices[name].asked[which]
        if request in self._polls:
            self._answer_poll(name, which, failure)
        else:
            written = ((client, asked) for client, asked in self.open.items() if asked.row and asked.row.device == name)
            client = next(client for client, asked in written if asked.sent == request.pdu)
            self._answer_write(client, name, which, failure)
        self.time_passes(0.0)

    def _answer_poll(self, name: str, which: int, failure: int | None) -> None:
        device = self.bench.devices[name]
        request = device.asked[which]
        first, count = int.from_bytes(request.pdu[1:3]), int.from_bytes(request.pdu[3:5])
        at, after = self._polls.pop(request)
        if failure is not None:
            device.answers(f"83 {failure:02X}", which)
            return
        words = self.registers[name][first : first + count]
        for row, known in self._known.items():
            covers = row.device == name and first <= row.first and row.first + row.taken <= first + count
            if covers and (known.said is None or known.at <= at):
                known.said = tuple(words[row.first - first : row.first - first + row.taken])
                known.at, known.after = at, after
                known.held = row.shown(known.said) or known.held
        device.answers(bytes((3, 2 * count)).hex() + "".join(f"{word:04X}" for word in words), which)

    def _answer_write(self, client: str, name: str, which: int, failure: int | None) -> None:
        asked = self.open.pop(client)
        first, words = _written(asked.sent)
        if failure is None:
            self.registers[name][first : first + len(words)] = words
        if failure not in WITHOUT_EFFECT:
            self._writes[name] += 1
            for row, known in self._known.items():
                if row.device == name and first < row.first + row.taken and row.first < first + len(words):
                    known.changed_by = self._writes[name]
        if failure is None:
            right = bytes((16, *asked.first.to_bytes(2), *asked.count.to_bytes(2)))
            self.bench.devices[name].answers(asked.sent[:5].hex(), which)
        else:
            right = bytes((16 | 0x80, failure))
            self.bench.devices[name].answers(bytes((asked.sent[0] | 0x80, failure)).hex(), which)
        assert self.clients[client].came() == [_shown(right)]

    # --- clients ---

    def read(self, client: str, first: int, count: int) -> None:
        """A client reads registers of rows; it has nothing else under way."""
        self.open[client] = Asked(first, count, dict(self._writes))
        self.clients[client].requested(bytes((3, *first.to_bytes(2), *count.to_bytes(2))))
        self.look()

    def write(self, client: str, row: Row, at: int, words: list[int]) -> None:
        """A client writes to a row, from its register `at` on, with function 16."""
        here, own = row.here, words
        if here is not None:
            value = (row.target or here).value(words)
            own = None if value is None else words if row.target is None else here.words(value)
        single = here is not None and own is not None and len(own) == 1
        sent = b"" if own is None else _write(row.first + at, own, single=single)
        device = self.bench.devices[row.device]
        before = device.questions
        asked = Asked(row.at + at, len(words), dict(self._writes), row, sent)
        self.clients[client].requested(_write(row.at + at, words))
        came = self.clients[client].came()
        assert device.questions[: len(before)] == before
        assert device.questions[len(before) :] == ([_shown(sent)] if sent else [])
        assert came == ([] if sent else ["90 03"])
        if sent:
            self.open[client] = asked

    def read_bits_and_ages(self, client: str) -> None:
        """A client reads what says how fresh the devices are."""
        (answer,) = self.clients[client].ask(f"03 {BITS_AT:04X} 0001")
        bits = int.from_bytes(bytes.fromhex(answer)[2:])
        assert bits >> len(self.names) == 0
        for number, name in enumerate(self.names):
            known = {row: known for row, known in self._known.items() if row.device == name}
            bit = bits >> number & 1
            assert not (bit and any(self._is_stale(row) for row in known))
            assert bit or not all(self._is_fresh(row, self._writes) for row in known)
            at = max((each.at for each in known.values() if each.said is not None), default=None)
            age = 0xFFFF if at is None else int(self.bench.now - at)
            came = self.clients[client].ask(f"03 {AGES_AT + number:04X} 0001")
            assert came == [_shown(bytes((3, 2, *age.to_bytes(2))))]

    # --- what is right ---

    def look(self) -> None:
        """Look at what has come for reads: what can be answered must be, and rightly."""
        for client, asked in list(self.open.items()):
            if asked.row is None:
                came = self.clients[client].came()
                fresh = {row: self._is_fresh(row, asked.writes) for row in self.touched(asked)}
                if came:
                    del self.open[client]
                    self._check(asked, *map(bytes.fromhex, came), fresh)
                else:
                    assert not all(fresh.values()), "a read waits, and all of it is fresh"
        for client, asked in self.open.items():
            devices = [self.bench.devices[row.device] for row in self.touched(asked)]
            is_waiting = any(each.asked or each.polls.deadline() is not None for each in devices)
            assert is_waiting, f"{client} waits for nothing"

    def touched(self, asked: Asked) -> list[Row]:
        """The rows of a request."""
        return [row for row in self.rows if row.at < asked.first + asked.count and asked.first < row.end]

    def _check(self, asked: Asked, answer: bytes, fresh: dict[Row, bool]) -> None:
        if answer[0] & 0x80:
            assert answer == b"\x83\x0b"
            assert any(not is_fresh and self._otherwise(row) is None for row, is_fresh in fresh.items())
            return
        assert answer[:2] == bytes((3, 2 * asked.count))
        registers = [int.from_bytes(answer[at : at + 2]) for at in range(2, len(answer), 2)]
        assert len(registers) == asked.count
        for row, is_fresh in fresh.items():
            expected = row.shown(self._known[row].said) if is_fresh else self._otherwise(row)
            assert expected is not None, f"{row} is not fresh"
            begin, end = max(row.at, asked.first), min(row.end, asked.first + asked.count)
            part = registers[begin - asked.first : end - asked.first]
            assert part == list(expected[begin - row.at : end - row.at]), row

    def _otherwise(self, row: Row) -> tuple[int, ...] | None:
        """What a read gets of a row that is not fresh; None for 0B."""
        if row.when_stale in ("exception", "hold"):
            return self._known[row].held if row.when_stale == "hold" else None
        return (row.when_stale,) * row.count

    def _is_fresh(self, row: Row, writes: dict[str, int]) -> bool:
        """Whether there is a fresh value that includes so many writes."""
        known = self._known[row]
        return not self._is_stale(row) and known.after >= min(known.changed_by, writes[row.device])

    def _is_stale(self, row: Row) -> bool:
        known = self._known[row]
        return known.said is None or self.bench.now - known.at > STALE or row.shown(known.said) is None


def _write(first: int, words, *, single: bool = False) -> bytes:
    if single:
        return bytes((6, *first.to_bytes(2), *words[0].to_bytes(2)))
    data = b"".join(word.to_bytes(2) for word in words)
    return bytes((16, *first.to_bytes(2), 0, len(words), len(data), *data))


def _written(pdu: bytes) -> tuple[int, list[int]]:
    data = pdu[3:] if pdu[0] == 6 else pdu[6:]
    return int.from_bytes(pdu[1:3]), [int.from_bytes(data[at : at + 2]) for at in range(0, len(data), 2)]


def _shown(pdu: bytes) -> str:
    return pdu.hex(" ").upper()
