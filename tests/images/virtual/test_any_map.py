"""Any map, and devices that answer in any order, late, wrongly or never."""

from fractions import Fraction

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from images.virtual.model import SIZE, SOURCES, WITHOUT_EFFECT, Model, Row
from soak.maps.conversion import Encoding

DEVICES = ("a", "b", "c")
CLIENTS = st.sampled_from(("one", "other"))
WORDS = st.lists(st.integers(0, 0xFFFF), min_size=SIZE, max_size=SIZE)
ENCODINGS = st.builds(
    Encoding,
    st.sampled_from(("uint16", "int16", "uint32", "int32", "uint64", "int64", "bcd16", "bcd32", "float32", "float64")),
    st.sampled_from(("none", "words", "bytes", "both")),
    st.sampled_from(("1", "0.1", "0.01", "-2", "1000", "0.3")),
    st.sampled_from(("0", "-40", "0.5", "100000")),
)
#: Whether each source has a value, and how that is encoded: rows of a source read the same.
KINDS = st.fixed_dictionaries(
    {(device, source): st.none() | ENCODINGS for device in DEVICES for source in range(SOURCES)}
)


@st.composite
def any_rows(draw, kinds, at=0):
    """Rows of some sources, one behind the other."""
    found = []
    for device, source in draw(st.lists(st.sampled_from(list(kinds)), min_size=1, max_size=6)):
        here = kinds[device, source]
        target = None if here is None else draw(st.none() | ENCODINGS)
        swap = "none" if here is not None else draw(st.sampled_from(("none", "none", "words", "both")))
        write = swap == "none" and draw(st.booleans())
        when_stale = draw(st.sampled_from(("exception", "hold", 0x7FC0)))
        found.append(Row(at, device, source, here, target, swap, write, when_stale))
        at = found[-1].end + draw(st.sampled_from((0, 0, 1)))
    return tuple(found)


class AnyMap(RuleBasedStateMachine):
    @initialize(kinds=KINDS, data=st.data())
    def begin(self, kinds, data):
        self.kinds = kinds
        self.model = Model(DEVICES, data.draw(any_rows(kinds)))

    @rule(seconds=st.sampled_from((0.0, 0.1, 0.5, 1.0, 2.5)))
    def time_passes(self, seconds):
        self.model.time_passes(seconds)

    @rule(name=st.sampled_from(DEVICES), source=st.integers(0, SOURCES - 1), words=WORDS, number=st.integers(-300, 300))
    def a_device_changes(self, name, source, words, number):
        here = self.kinds[name, source]
        if here is not None and words[-1] & 1:  # a number that is likely to fit elsewhere, too
            fitting = here.words(number * Fraction(here.scale) + Fraction(here.offset))
            words[: here.count] = fitting or words[: here.count]
        if not _is_minus_zero(here, words):
            self.model.registers[name][SIZE * source : SIZE * (source + 1)] = words

    @rule(name=st.sampled_from(DEVICES))
    def a_device_rests_or_not(self, name):
        device = self.model.bench.devices[name]
        device.rests = not device.rests

    @rule(data=st.data(), failure=st.sampled_from((None, None, None, 4, 11, *WITHOUT_EFFECT)))
    def a_device_answers(self, data, failure):
        devices = self.model.bench.devices
        asked = [(name, at) for name, device in devices.items() for at in range(len(device.asked))]
        if asked:
            self.model.answer(*data.draw(st.sampled_from(asked)), failure)

    @rule(number=st.integers(0, 0xFFF0))
    def all_devices_change_and_answer(self, number):
        for (name, source), here in self.kinds.items():
            if here is None or here.type in ("uint16", "uint32"):
                words = [number + 7 * at & 0xFFFF for at in range(SIZE)]
                self.model.registers[name][SIZE * source : SIZE * (source + 1)] = words
        self.model.time_passes(1.0)
        for name, device in self.model.bench.devices.items():
            while device.asked:
                self.model.answer(name, 0, None)

    @rule(client=CLIENTS, data=st.data())
    def a_client_reads(self, client, data):
        if client in self.model.open:
            return
        places = sorted({at for row in self.model.rows for at in range(row.at, row.end)})
        first = last = data.draw(st.sampled_from(places))
        while last + 1 in places and data.draw(st.integers(0, 8)):
            last += 1
        self.model.read(client, first, last + 1 - first)

    @rule(client=CLIENTS)
    def a_client_reads_bits_and_ages(self, client):
        if client not in self.model.open:
            self.model.read_bits_and_ages(client)

    @rule(client=CLIENTS, words=WORDS, data=st.data(), is_answered=st.booleans())
    def a_client_writes(self, client, words, data, is_answered):
        rows = [row for row in self.model.rows if row.write]
        if self.model.open or not rows:
            return
        row, at = data.draw(st.sampled_from(rows)), 0
        if row.here is None:
            at = data.draw(st.integers(0, SIZE - 1))
            words = words[at:]
        else:
            words = list((row.shown(words) if words[-1] & 1 else None) or words[: row.count])
            words += [0] * (row.count - len(words))
        if _is_minus_zero(row.target or row.here, words):
            return
        self.model.write(client, row, at, words)
        if client in self.model.open and is_answered:
            self.model.answer(row.device, -1, None)
            self.model.read(client, row.at, row.count)

    @precondition(lambda self: not self.model.open)
    @rule(data=st.data(), count=st.integers(0, 6))
    def another_map(self, data, count):
        kept = self.model.rows[:count]
        new = data.draw(any_rows(self.kinds, kept[-1].end if kept else 0))
        self.model.reload((*kept, *new)[:8])

    def teardown(self):
        if hasattr(self, "model"):
            for device in self.model.bench.devices.values():
                device.rests = False
            for _ in range(20):
                self.model.time_passes(0.5)
                self.model.fail_everything()
            assert not self.model.open


def _is_minus_zero(how, words):
    """Whether this is -0.0, which is 0 elsewhere."""
    if how is None or not how.type.startswith("float"):
        return False
    own = words[: how.count]
    return any(own) and how.value(own) == Fraction(how.offset)


TestAnyMap = AnyMap.TestCase
