"""What is heard of a device that only others ask, for a mirror and for a virtual unit. Time is a number."""

import pytest

from gateway.images.heard_values import HeardValues
from gateway.images.image import Image, ImageSettings
from gateway.images.mirror import Mirror
from gateway.images.polls import MirrorSettings, Poll
from gateway.images.virtual.row import Source
from gateway.images.virtual.settings import FreshBits, MappedValue, VirtualSettings
from gateway.images.virtual.unit import VirtualUnit
from gateway.lines.monitor.monitor import HeardTransaction
from gateway.modbus.codes import Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import Span, parse_request
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.request import Caller, Origin, Request, Target

GENERIC = Profile("generic")
STALE = 2.0
#: Holding 0-9: 100, 101, ...
TEN = "03 14" + "".join(f" {100 + number:04X}" for number in range(10))


class Client(Origin):
    """Asks a unit at once."""

    def __init__(self, unit: Mirror | VirtualUnit) -> None:
        self.caller = Caller("10.0.0.9:1", "127.0.0.1", "127.0.0.1")
        self._unit = unit
        self._answer: str | None = None

    def wants(self, request):
        return True

    def answer(self, request, pdu):
        self._answer = pdu.hex(" ").upper()

    def asks(self, pdu: str, now: float) -> str | None:
        self._answer = None
        self.request = Request(241, bytes.fromhex(pdu), self, now)
        self._unit.submit(self.request, now)
        return self._answer


class Bench(Target):
    """Values that are heard, and a unit that wants them; a device that is never asked."""

    def __init__(self) -> None:
        self.values = HeardValues()
        self.passed_on: list[Request] = []

    def submit(self, request, now):
        self.passed_on.append(request)

    def mirror(self, *ranges: tuple[int, int], together: tuple[Span, ...] = (), area: Area = Area.HOLDING) -> Client:
        polls = tuple(Poll(area, first, last, 0.0) for first, last in ranges)
        settings = MirrorSettings(
            241, "m", "boiler", GENERIC, polls, {area: ranges}, STALE, "g.toml:9", together=together
        )
        self.unit = Mirror(settings, self.values, self, None, [].append)
        self.values.change([part for _, part in self.unit.wanted()], (), 0.0)
        return Client(self.unit)

    def virtual(self, *rows: MappedValue, fresh: FreshBits | None = None) -> Client:
        spans = [row.place for row in rows] + ([] if fresh is None else [fresh.place])
        areas = {Area.HOLDING: ((0, max(span.end for span in spans) - 1),)}
        own = ImageSettings(unit=240, name="v", profile=GENERIC, areas={}, initial={}, persist="never", source="")
        settings = VirtualSettings(
            240, "v", GENERIC, areas, own, rows, () if fresh is None else (fresh,), (), STALE, "g.toml:9"
        )
        sources = {"boiler": Source(self.values, self, GENERIC)}
        self.unit = VirtualUnit(settings, sources, Image(own, [].append), None, [].append)
        self.values.change([part for _, part in self.unit.wanted()], (), 0.0)
        return Client(self.unit)

    def hears(self, asked: str, response: str | None, at: float, *, told: float | None = None, sure: bool = True):
        """Others have asked, and the answer has come a little later."""
        told = at + 0.01 if told is None else told
        frame = None if response is None else Frame(3, bytes.fromhex(response))
        pdu = parse_request(bytes.fromhex(asked))
        self.values.heard(HeardTransaction(3, pdu, frame, at, told, sure), told)


@pytest.fixture
def bench():
    return Bench()


def test_what_was_never_heard_is_0b_at_once_and_its_addresses_are_told(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0002 0002", "03 04 0001 0002", 4.0)
    assert client.asks("03 0002 0002", 5.0) == "03 04 00 01 00 02"
    assert client.asks("03 0000 0003", 5.0) == "83 0B"
    assert str(client.request.error) == "boiler (holding 0) was never heard, or too long ago"


def test_a_mirror_has_what_was_heard_until_it_is_stale(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0)
    assert client.asks("03 0002 0002", 1.5) == "03 04 00 66 00 67"
    assert client.asks("03 0002 0002", 3.0) == "03 04 00 66 00 67"
    assert client.asks("03 0002 0002", 3.001) == "83 0B"


def test_the_age_counts_from_the_request(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0, told=2.5)
    assert client.asks("03 0000 0001", 3.1) == "83 0B"


def test_a_late_answer_replaces_none_to_a_later_request(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 0001", "03 02 0002", 2.0)
    bench.hears("03 0000 000A", TEN, 1.0, told=2.5)
    assert client.asks("03 0000 0002", 2.6) == "03 04 00 02 00 65"


def test_each_register_has_its_own_age(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 0005", "03 0A 0001 0002 0003 0004 0005", 1.0)
    assert client.asks("03 0000 0005", 1.5) == "03 0A 00 01 00 02 00 03 00 04 00 05"
    assert client.asks("03 0004 0002", 1.5) == "83 0B"
    bench.hears("03 0005 0005", "03 0A 0006 0007 0008 0009 000A", 2.5)
    assert client.asks("03 0004 0002", 2.6) == "03 04 00 05 00 06"
    assert client.asks("03 0004 0002", 3.5) == "83 0B"
    assert client.asks("03 0005 0002", 3.5) == "03 04 00 06 00 07"
    assert [(str(poll), age) for poll, age in bench.unit.ages(3.5)] == [("holding 0-4", 2.5), ("holding 5-9", 1.0)]


def test_only_what_is_declared_is_there(bench):
    client = bench.mirror((2, 4))
    bench.hears("03 0000 000A", TEN, 1.0)
    assert client.asks("03 0002 0003", 1.5) == "03 06 00 66 00 67 00 68"
    assert client.asks("03 0004 0002", 1.5) == "83 02"


def test_a_value_of_two_registers_is_never_put_together_out_of_two_answers(bench):
    client = bench.mirror((0, 3), together=(Span(Area.HOLDING, 1, 2),))
    bench.hears("03 0000 0004", "03 08 0001 0002 0003 0004", 1.0)
    bench.hears("03 0002 0002", "03 04 0033 0044", 2.0)
    assert client.asks("03 0000 0004", 2.1) == "03 08 00 01 00 02 00 03 00 44"


def test_what_is_not_sure_is_no_value(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0, sure=False)
    assert client.asks("03 0000 0001", 1.5) == "83 0B"


@pytest.mark.parametrize("response", [None, "83 04"])
def test_what_was_not_answered_changes_nothing(bench, response):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0)
    bench.hears("03 0000 000A", response, 1.5)
    assert client.asks("03 0000 0001", 2.0) == "03 02 00 64"


@pytest.mark.parametrize(
    ("asked", "response", "sure"),
    [
        ("06 0002 0001", "06 0002 0001", True),
        ("06 0002 0001", None, False),
        ("06 0002 0001", "86 04", True),
        ("06 0002 0001", "86 02", False),
        ("10 0001 0002 04 0001 0001", "10 0001 0002", True),
        ("16 0002 0001 0001", "16 0002 0001 0001", True),
    ],
)
def test_what_was_written_is_unknown_until_it_is_heard_again(bench, asked, response, sure):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0)
    bench.hears(asked, response, 1.2, sure=sure)
    assert client.asks("03 0002 0001", 1.3) == "83 0B"
    assert client.asks("03 0003 0001", 1.3) == "03 02 00 67"
    bench.hears("03 0002 0001", "03 02 0001", 1.4)
    assert client.asks("03 0002 0001", 1.5) == "03 02 00 01"


def test_a_write_that_was_surely_refused_changes_nothing(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0)
    bench.hears("06 0002 0001", "86 02", 1.2)
    assert client.asks("03 0002 0001", 1.3) == "03 02 00 66"


def test_a_function_that_may_write_anything_makes_all_unknown(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 000A", TEN, 1.0)
    bench.hears("64 00", "64 00", 1.2)
    assert client.asks("03 0000 0001", 1.3) == "83 0B"


def test_a_read_from_before_a_write_ended_is_no_value(bench):
    client = bench.mirror((0, 9))
    bench.hears("06 0002 0001", None, 1.0, told=6.0)
    bench.hears("03 0000 000A", TEN, 5.9, told=6.1)
    assert client.asks("03 0002 0001", 6.2) == "83 0B"


def test_function_23_writes_and_then_reads(bench):
    client = bench.mirror((0, 3))
    bench.hears("03 0000 0004", "03 08 0001 0002 0003 0004", 1.0)
    bench.hears("17 0000 0002 0001 0002 04 0007 0008", "17 04 0001 0007", 1.2)
    assert client.asks("03 0000 0002", 1.3) == "03 04 00 01 00 07"
    assert client.asks("03 0002 0001", 1.3) == "83 0B"
    assert client.asks("03 0003 0001", 1.3) == "03 02 00 04"


def test_coils(bench):
    client = bench.mirror((3, 12), area=Area.COILS)
    bench.hears("01 0000 0010", "01 02 F8 05", 1.0)
    assert client.asks("01 0003 000A", 1.1) == "01 02 BF 00"


def test_all_else_goes_to_the_device_which_refuses_it(bench):
    client = bench.mirror((0, 9))
    assert client.asks("06 0002 0001", 1.0) is None
    assert [request.pdu.hex() for request in bench.passed_on] == ["0600020001"]


def row(place: int, poll: Poll, **keys: object) -> MappedValue:
    count = poll.span.count
    return MappedValue(Span(Area.HOLDING, place, count), "boiler", poll, **keys)  # type: ignore[arg-type]


def test_a_row_of_a_map_is_taken_from_one_answer(bench):
    bit = FreshBits(Span(Area.HOLDING, 3, 1), ("boiler",))
    client = bench.virtual(row(0, Poll(Area.HOLDING, 4, 6, 0.0), when_stale="hold"), fresh=bit)
    assert client.asks("03 0003 0001", 1.0) == "03 02 00 00"
    bench.hears("03 0004 0002", "03 04 0001 0002", 1.0)
    bench.hears("03 0006 0001", "03 02 0003", 1.0)
    assert client.asks("03 0000 0004", 1.1) == "83 0B"
    bench.hears("03 0000 000A", TEN, 1.2)
    assert client.asks("03 0000 0004", 1.3) == "03 08 00 68 00 69 00 6A 00 01"
    assert client.asks("03 0000 0004", 3.3) == "03 08 00 68 00 69 00 6A 00 00"


def test_a_point_that_is_written_elsewhere_is_unknown_after_that(bench):
    point = Point("limit", Area.HOLDING, 4, write="yes", write_at=120)
    client = bench.virtual(row(0, Poll.of(point), point=point))
    bench.hears("03 0000 000A", TEN, 1.0)
    assert client.asks("03 0000 0001", 1.1) == "03 02 00 68"
    bench.hears("06 0078 0001", "06 0078 0001", 1.2)
    assert client.asks("03 0000 0001", 1.3) == "83 0B"


def test_who_comes_later_waits_for_the_next_answer_and_who_goes_gets_none(bench):
    bench.mirror((0, 9))
    first = bench.unit
    bench.hears("03 0000 000A", TEN, 1.0)
    client = bench.mirror((0, 9))
    assert client.asks("03 0000 0001", 1.1) == "83 0B"
    bench.values.change((), first.parts, 1.2)
    bench.hears("03 0000 000A", TEN.replace("0064", "0001"), 1.3)
    assert client.asks("03 0000 0001", 1.4) == "03 02 00 01"
    assert first.values(Span(Area.HOLDING, 0, 1)) == b"\x00\x64"


def test_an_answer_of_another_size_is_no_value(bench):
    client = bench.mirror((0, 9))
    bench.hears("03 0000 0004", "03 02 0001", 1.0)
    assert client.asks("03 0000 0001", 1.1) == "83 0B"
