"""Any map, and devices that answer in any order, late, wrongly or never: a model in a few lines says what clients get.

The model knows what each device has said, and which writes had finished when it was asked. It does not know how polls
are joined, how values are kept, or what is remembered of reads.
"""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from gateway.images.polls import Poll
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from images.virtual.bench import Bench
from soak.maps.conversion import Encoding, turned

STALE = 2.0
DEVICES = ("a", "b", "c")
#: Each source has so many registers, so that no two rows of a device overlap without being equal.
SIZE = 4
SOURCES = 5
BITS_AT, AGES_AT = 200, 210
_WHOLE = ("uint16", "int16", "uint32", "int32", "uint64", "int64", "bcd16", "bcd32")
_TYPES = (*_WHOLE, "float32", "float64")
_WITHOUT_EFFECT = (1, 2, 3, 6, 10)

encodings = st.builds(
    Encoding,
    st.sampled_from(_TYPES),
    st.sampled_from(("none", "words", "bytes", "both")),
    st.sampled_from(("1", "0.1", "0.01", "-2", "1000", "0.3")),
    st.sampled_from(("0", "-40", "0.5", "100000")),
)


@dataclass(frozen=True)
class Row:
    """A row at `at`, of a source of a device: all of its registers, or a value there that is encoded as `target`."""

    at: int
    device: str
    source: int
    here: Encoding | None
    target: Encoding | None
    swap: str
    write: bool
    when_stale: Any

    @property
    def first(self) -> int:
        return SIZE * self.source

    @property
    def count(self) -> int:
        return SIZE if self.here is None else (self.target or self.here).count

    @property
    def taken(self) -> int:
        return SIZE if self.here is None else self.here.count

    def shown(self, registers: tuple[int, ...]) -> tuple[int, ...] | None:
        """What it shows of the registers of its source."""
        if self.here is None:
            pairs = [turned(registers[at : at + 2], self.swap) for at in range(0, SIZE, 2)]
            return registers if self.swap == "none" else tuple(word for pair in pairs for word in pair)
        value = self.here.value(registers[: self.taken])
        if value is None:
            return None
        return registers[: self.taken] if self.target is None else self.target.words(value)

    @property
    def mapped(self) -> MappedValue:
        """As the gateway has it."""
        poll = Poll(Area.HOLDING, self.first, self.first + self.taken - 1, 1.0)
        point = None if self.here is None else _point(self.here, self.first)
        target = None if self.target is None else _point(self.target, self.at)
        return MappedValue(
            Span(Area.HOLDING, self.at, self.count),
            self.device,
            poll,
            point,
            target,
            self.swap,
            self.write,
            self.when_stale,
        )


def _point(how: Encoding, at: int) -> Point:
    return Point(
        "value",
        Area.HOLDING,
        at,
        how.type,
        how.swap,
        how.count,
        float(how.scale),
        offset=float(how.offset),
        write="yes",
    )


@st.composite
def rows(draw, kinds):
    """Rows of some sources, one behind the other; a source always has the same kind, so that equal polls are equal."""
    found, at = [], 0
    for device, source in draw(st.lists(st.sampled_from(list(kinds)), min_size=1, max_size=6)):
        here = kinds[device, source]
        target = None if here is None else draw(st.none() | encodings)
        swap = "none" if here is not None else draw(st.sampled_from(("none", "none", "words", "both")))
        write = swap == "none" and draw(st.booleans())
        when_stale = draw(st.sampled_from(("exception", "hold", 0x7FC0)))
        found.append(Row(at, device, source, here, target, swap, write, when_stale))
        at = found[-1].at + found[-1].count + draw(st.sampled_from((0, 0, 1)))
    return tuple(found)


kinds_of_sources = st.fixed_dictionaries(
    {(device, source): st.none() | encodings for device in DEVICES for source in range(SOURCES)}
)


@dataclass
class Said:
    """What a device said last to a row: when it was asked, after how many finished writes, and what."""

    at: float
    after: int
    registers: tuple[int, ...]


@dataclass
class Known:
    """What is known of a row. `held` is its last valid value."""

    said: Said | None = None
    changed_by: int = 0
    held: tuple[int, ...] | None = None


@dataclass
class Asked:
    """A client's open request: so many `writes` had finished then. A write has its row, and what is to be sent."""

    pdu: str
    first: int
    count: int
    writes: dict[str, int]
    row: Row | None = None
    sent: str = ""


@dataclass
class World:
    """Devices with their registers, which change now and then, and how many writes to each have finished."""

    registers: dict[str, list[int]] = field(default_factory=lambda: {name: [0] * SIZE * SOURCES for name in DEVICES})
    writes: dict[str, int] = field(default_factory=lambda: dict.fromkeys(DEVICES, 0))


class AnyMap(RuleBasedStateMachine):
    @initialize(kinds=kinds_of_sources, data=st.data())
    def begin(self, kinds, data):
        self.kinds = kinds
        self.world = World()
        self.known = {}
        self.polls: dict[Any, tuple[float, int]] = {}
        self.open: dict[str, Asked] = {}
        self.rows = data.draw(rows(kinds))
        fresh, ages = self._specials()
        self.bench = Bench(*(row.mapped for row in self._anchors()), stale=STALE)
        self.bench.reload(self.bench.made(*(row.mapped for row in self.rows), stale=STALE, fresh=fresh, ages=ages))
        self.known = {row.at: Known() for row in self.rows}
        self.clients = {name: self.bench.client(name) for name in ("one", "other")}
        self._send_polls()

    def _anchors(self):
        """A row of each device, so that all of them are there."""
        return [Row(SIZE * at, name, 0, None, None, "none", False, "exception") for at, name in enumerate(DEVICES)]

    def _specials(self):
        self.names = tuple(dict.fromkeys(row.device for row in self.rows))
        ages = tuple(SourceAge(Span(Area.HOLDING, AGES_AT + at, 1), name) for at, name in enumerate(self.names))
        return (FreshBits(Span(Area.HOLDING, BITS_AT, 1), self.names),), ages

    # --- time and devices ---

    def _send_polls(self):
        """Send polls that are due, and note what had finished then."""
        for name, device in self.bench.devices.items():
            self.bench.poll(device)
            for request in device.asked:
                if request.origin is device and request not in self.polls:
                    self.polls[request] = self.bench.now, self.world.writes[name]
        self._look()

    @rule(seconds=st.sampled_from((0.0, 0.1, 0.5, 1.0, 2.5)))
    def time_passes(self, seconds):
        self.bench.now += seconds
        self._send_polls()

    @rule(name=st.sampled_from(DEVICES), source=st.integers(0, SOURCES - 1), data=st.data())
    def a_device_changes(self, name, source, data):
        here = self.kinds[name, source]
        words = data.draw(st.lists(st.integers(0, 0xFFFF), min_size=SIZE, max_size=SIZE))
        if here is not None and data.draw(st.booleans()):  # a number that is likely to fit elsewhere, too
            number = data.draw(st.integers(-300, 300)) * Fraction(here.scale) + Fraction(here.offset)
            words[: here.count] = here.words(number) or words[: here.count]
        if here is not None and _is_minus_zero(here, words):
            words = [0] * SIZE
        self.world.registers[name][SIZE * source : SIZE * (source + 1)] = words

    @rule(name=st.sampled_from(DEVICES))
    def a_device_rests_or_not(self, name):
        self.bench.devices[name].rests = not self.bench.devices[name].rests

    @rule(data=st.data(), failure=st.sampled_from((None, None, None, 2, 4, 6, 11, 10)))
    def a_device_answers(self, data, failure):
        waiting = [(name, at) for name, device in self.bench.devices.items() for at in range(len(device.asked))]
        if waiting:
            self._answer(*data.draw(st.sampled_from(waiting)), failure)

    @rule(changes=st.booleans(), number=st.integers(0, 0xFFFF))
    def all_devices_answer(self, changes, number):
        if changes:
            for name, words in self.world.registers.items():
                at = [number + 7 * place for place in range(len(words))]
                kinds = [self.kinds[name, place // SIZE] for place in range(len(words))]
                free = [kind is None or kind.type in ("uint16", "int16", "uint32", "int32") for kind in kinds]
                words[:] = [new & 0xFFFF if is_free else old for new, old, is_free in zip(at, words, free, strict=True)]
        self.time_passes(1.0)
        for name, device in self.bench.devices.items():
            while device.asked:
                self._answer(name, 0, None)

    def _answer(self, name, at, failure):
        device = self.bench.devices[name]
        request = device.asked[at]
        pdu = request.pdu
        if request.origin is device:
            self._answer_poll(name, at, failure)
        else:
            asked = next(
                each for each in self.open.values() if each.row is not None and each.sent == pdu.hex(" ").upper()
            )
            self._finish_write(name, at, asked, failure)
        self._look()
        self._send_polls()

    def _answer_poll(self, name, which, failure):
        request = self.bench.devices[name].asked[which]
        first, count = int.from_bytes(request.pdu[1:3]), int.from_bytes(request.pdu[3:5])
        at, after = self.polls.pop(request)
        if failure is not None:
            self.bench.devices[name].answers(f"83 {failure:02X}", which)
            return
        words = self.world.registers[name][first : first + count]
        for row in self.rows:
            known = self.known[row.at]
            covers = row.device == name and first <= row.first and row.first + row.taken <= first + count
            if covers and (known.said is None or known.said.at <= at):
                known.said = Said(at, after, tuple(words[row.first - first : row.first - first + row.taken]))
                shown = row.shown(known.said.registers)
                known.held = known.held if shown is None else shown
        data = "".join(f"{word:04X}" for word in words)
        self.bench.devices[name].answers(f"03 {2 * count:02X} {data}", which)

    def _finish_write(self, name, at, asked, failure):
        row, pdu = asked.row, bytes.fromhex(asked.sent)
        if failure is None:
            first = int.from_bytes(pdu[1:3])
            words = pdu[3:] if pdu[0] == 6 else pdu[6:]
            for place in range(0, len(words), 2):
                self.world.registers[name][first + place // 2] = int.from_bytes(words[place : place + 2])
        if failure not in _WITHOUT_EFFECT:
            self.world.writes[name] += 1
            for each in self.rows:
                if (each.device, each.source) == (row.device, row.source) and self._touches(pdu, each):
                    self.known[each.at].changed_by = self.world.writes[name]
        if failure is None:
            self.bench.devices[name].answers(asked.sent if pdu[0] == 6 else pdu[:5].hex(), at)
        else:
            self.bench.devices[name].answers(f"{pdu[0] | 0x80:02X} {failure:02X}", at)
        client = next(client for client, each in self.open.items() if each is asked)
        del self.open[client]
        sent = bytes.fromhex(asked.pdu)
        right = sent if sent[0] == 6 else sent[:5]
        expected = right if failure is None else bytes((sent[0] | 0x80, failure))
        assert self.clients[client].came() == [expected.hex(" ").upper()]

    def _touches(self, pdu, row):
        first = int.from_bytes(pdu[1:3])
        count = 1 if pdu[0] == 6 else int.from_bytes(pdu[3:5])
        return first < row.first + row.taken and row.first < first + count

    # --- clients ---

    @rule(name=st.sampled_from(("one", "other")), data=st.data())
    def a_client_reads(self, name, data):
        if name in self.open:
            return
        places = sorted({at for row in self.rows for at in range(row.at, row.at + row.count)})
        first = data.draw(st.sampled_from(places))
        last = first
        while last + 1 in places and data.draw(st.integers(0, 8)):
            last += 1
        self._read(name, first, last + 1 - first)

    def _read(self, name, first, count):
        asked = Asked(f"03 {first:04X} {count:04X}", first, count, dict(self.world.writes))
        self.open[name] = asked
        self.clients[name]._came = self.clients[name].ask(asked.pdu)
        self._look()

    @rule(name=st.sampled_from(("one", "other")))
    def a_client_reads_bits_and_ages(self, name):
        if name in self.open:
            return
        ((answer,),) = [self.clients[name].ask(f"03 {BITS_AT:04X} 0001")]
        bits = int(answer[6:].replace(" ", ""), 16)
        for at, device in enumerate(self.names):
            rows = [(row, self.known[row.at]) for row in self.rows if row.device == device]
            if any(self._is_stale(row, known) for row, known in rows):
                assert not bits >> at & 1
            elif all(self._is_fresh(row, known, self.world.writes[device]) for row, known in rows):
                assert bits >> at & 1
            last = max((known.said.at for _, known in rows if known.said is not None), default=None)
            expected = 0xFFFF if last is None else int(self.bench.now - last)
            assert self.clients[name].ask(f"03 {AGES_AT + at:04X} 0001") == [
                f"03 02 {expected >> 8:02X} {expected & 255:02X}"
            ]
        assert bits >> len(self.names) == 0

    @rule(name=st.sampled_from(("one", "other")), data=st.data())
    def a_client_writes(self, name, data):
        writable = [row for row in self.rows if row.write]
        if name in self.open or not writable:
            return
        row = data.draw(st.sampled_from(writable))
        asked = self._write_to(row, data)
        if asked is None or any(other.sent == asked.sent for other in self.open.values()):
            return
        device = self.bench.devices[row.device]
        before = len(device.asked)
        came = self.clients[name].ask(asked.pdu)
        if not asked.sent:
            assert came == [f"{int(asked.pdu[:2], 16) | 0x80:02X} 03"]
            assert len(device.asked) == before
            return
        assert came == []
        assert device.questions[before:] == [asked.sent]
        self.open[name] = asked
        if data.draw(st.booleans()):
            self._answer(row.device, before, None)
            self._read(name, row.at, row.count)

    def _write_to(self, row, data):
        """A write to a row, and what its device is to get: nothing if the value does not fit."""
        words = data.draw(st.lists(st.integers(0, 0xFFFF), min_size=row.count, max_size=row.count))
        if row.here is None:
            first = data.draw(st.integers(0, SIZE - 1))
            count = data.draw(st.integers(1, SIZE - first))
            words = words[:count]
            return self._asked(row, row.at + first, words, row.first + first, words)
        if data.draw(st.booleans()):  # what the row would show for some value of the device
            words = row.shown(tuple(data.draw(st.lists(st.integers(0, 0xFFFF), min_size=SIZE, max_size=SIZE)))) or words
        here, target = row.here, row.target or row.here
        if _is_minus_zero(target, words):
            return None
        value = target.value(words)
        own = None if value is None else (here.words(value) if row.target is not None else tuple(words))
        return self._asked(row, row.at, words, row.first, own)

    def _asked(self, row, at, words, there, own):
        sent = "" if own is None else _write(there, own, single=len(own) == 1)
        if row.here is None:
            sent = _write(there, own, single=False)
        asked = _write(at, words, single=False)
        return Asked(asked, at, len(words), dict(self.world.writes), row, sent)

    # --- what is right ---

    def _look(self):
        """Look at what has come for reads: all that can be answered must be, and rightly."""
        for name, asked in list(self.open.items()):
            if asked.row is not None:
                continue
            came, self.clients[name]._came = self.clients[name]._came, []
            touched = [
                row for row in self.rows if row.at < asked.first + asked.count and asked.first < row.at + row.count
            ]
            fresh = {row: self._is_fresh(row, self.known[row.at], asked.writes[row.device]) for row in touched}
            if not came:
                assert not all(fresh.values()), f"{asked} waits, and all of it is fresh"
                continue
            del self.open[name]
            assert len(came) == 1
            answer = bytes.fromhex(came[0])
            if answer[0] & 0x80:
                assert answer == b"\x83\x0b"
                assert any(not is_fresh and self._has_nothing_else(row) for row, is_fresh in fresh.items())
                continue
            registers = [int.from_bytes(answer[at : at + 2]) for at in range(2, len(answer), 2)]
            assert len(registers) == asked.count
            for row in touched:
                begin, end = max(row.at, asked.first), min(row.at + row.count, asked.first + asked.count)
                part = registers[begin - asked.first : end - asked.first]
                assert part == list(self._expected(row, fresh[row])[begin - row.at : end - row.at]), row

    def _touched(self, asked):
        return [row for row in self.rows if row.at < asked.first + asked.count and asked.first < row.at + row.count]

    def _expected(self, row, is_fresh):
        known = self.known[row.at]
        if is_fresh:
            return row.shown(known.said.registers)
        assert not self._has_nothing_else(row), f"{row} is not fresh"
        return known.held if row.when_stale == "hold" else (row.when_stale,) * row.count

    def _has_nothing_else(self, row):
        """Whether a read of a row that is not fresh gets 0B."""
        return row.when_stale == "exception" or (row.when_stale == "hold" and self.known[row.at].held is None)

    def _is_fresh(self, row, known, writes):
        said = known.said
        if said is None or self._is_stale(row, known):
            return False
        return said.after >= min(known.changed_by, writes)

    def _is_stale(self, row, known):
        said = known.said
        return said is None or self.bench.now - said.at > STALE or row.shown(said.registers) is None

    # --- reloads, and the end ---

    @precondition(lambda self: not self.open)
    @rule(data=st.data(), count=st.integers(0, 6))
    def another_map(self, data, count):
        """A reload keeps some rows as they are; no poll is under way."""
        self._drain()
        before, kept = self.known, self.rows[:count]
        old = dict.fromkeys(self.rows)
        at = max((row.at + row.count for row in kept), default=0)
        new = [
            Row(row.at + at, row.device, row.source, row.here, row.target, row.swap, row.write, row.when_stale)
            for row in data.draw(rows(self.kinds))
        ]
        self.rows = (*kept, *new)[:8]
        self.known = {row.at: before[row.at] if row in old else Known() for row in self.rows}
        fresh, ages = self._specials()
        self.bench.reload(self.bench.made(*(row.mapped for row in self.rows), stale=STALE, fresh=fresh, ages=ages))
        self._send_polls()

    def _drain(self):
        """Let all devices fail to answer what they were asked, until nothing is asked."""
        for name, device in self.bench.devices.items():
            while device.asked:
                self._answer(name, 0, 11)

    @invariant()
    def nobody_waits_for_nothing(self):
        if getattr(self, "bench", None) is None:
            return
        self._look()
        for name, asked in self.open.items():
            rows_ = [
                row for row in self.rows if row.at < asked.first + asked.count and asked.first < row.at + row.count
            ]
            devices = {asked.row.device} if asked.row is not None else {row.device for row in rows_}
            sources = [self.bench.devices[each] for each in devices]
            assert any(each.asked or each.polls.deadline() is not None for each in sources), f"{name} waits for nothing"

    def teardown(self):
        if getattr(self, "bench", None) is not None:
            for device in self.bench.devices.values():
                device.rests = False
            for _ in range(20):
                self.time_passes(0.5)
                self._drain()
            assert not self.open


def _is_minus_zero(how, words):
    """Whether this is -0.0, which is 0 elsewhere."""
    return (
        how.type.startswith("float")
        and any(words[: how.count])
        and how.value(words[: how.count]) == Fraction(how.offset)
    )


def _write(first, words, *, single):
    if single:
        return bytes((6, *first.to_bytes(2), *words[0].to_bytes(2))).hex(" ").upper()
    data = b"".join(word.to_bytes(2) for word in words)
    return bytes((16, *first.to_bytes(2), 0, len(words), len(data), *data)).hex(" ").upper()


TestAnyMap = AnyMap.TestCase
