"""A unit made in Python as a target: what it is asked for each function, whose turn it is, and what its clients get."""

from collections import deque

import pytest

from gateway.errors import Busy, DeviceFailure, IllegalAddress, LineDown
from gateway.events import Event, RequestRefused, RequestTimeout, UnitRecovered, UnitResting
from gateway.images.custom_calls import Call
from gateway.images.custom_image import MOST_WAITING, CustomImage
from gateway.images.image import ImageSettings
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.routing.broadcast import Broadcast, Recipient
from images.asking import GENERIC, MINT
from kit.asker import Asker

EVERYWHERE = dict.fromkeys(Area, ((0, 0xFFFF),))


class Stage:
    """An image, and in place of its unit the test: `calls` are those that have begun, `cancelled` counts."""

    def __init__(self, profile: Profile = GENERIC, *, timeout: float = 1.0, areas=EVERYWHERE) -> None:
        self.calls: deque[Call] = deque()
        self.cancelled = 0
        self.withdraws = False
        self.wakes_at: float | None = None
        self.events: list[Event] = []
        settings = ImageSettings(60, "clock", profile, areas, python="Clock", timeout=timeout, source="g.toml:9")
        self.image = CustomImage(settings, self, self.events.append)
        self.now = 0.0

    def begin(self, call: Call) -> None:
        self.calls.append(call)

    def cancel(self) -> bool:
        self.cancelled += 1
        return not self.withdraws

    def wake_at(self, deadline: float | None) -> None:
        self.wakes_at = deadline

    def ask(self, client: Asker, pdu: str, unit: int = 60) -> None:
        self.image.submit(client.ask(pdu, unit=unit, now=self.now), self.now)

    def asks(self, pdu: str, *results: object) -> tuple[list[Call], str | None]:
        """Ask alone, and end each call with the next of `results`: its calls, and the answer."""
        client, made = Asker(), []
        self.ask(client, pdu)
        for result in results:
            made.append(self.calls.popleft())
            self.end(result)
        (answer,) = client.answers
        return made, answer

    def end(self, result: object) -> None:
        self.image.ended(bytes.fromhex(result) if isinstance(result, str) else result, self.now)

    def wait(self, seconds: float) -> None:
        """Let time pass, with a tick whenever one is due."""
        until = self.now + seconds
        while self.wakes_at is not None and self.wakes_at <= until:
            self.now = max(self.now, self.wakes_at)
            self.image.tick(self.now)
        self.now = until


def holding(start: int, count: int = 1, *values: int) -> Call:
    return Call(Span(Area.HOLDING, start, count), values or None)


def coils(start: int, count: int = 1, *values: int) -> Call:
    return Call(Span(Area.COILS, start, count), values or None)


@pytest.mark.parametrize(
    ("pdu", "calls", "results", "answer"),
    [
        ("01 0003 0003", [coils(3, 3)], ["01 00 01"], "01 01 05"),
        ("02 0003 0009", [Call(Span(Area.DISCRETE, 3, 9))], ["00 01 00 00 00 00 00 00 01"], "02 02 02 01"),
        ("03 0010 0002", [holding(16, 2)], ["0001 BEEF"], "03 04 00 01 BE EF"),
        ("04 0010 0001", [Call(Span(Area.INPUT, 16, 1))], ["0007"], "04 02 00 07"),
        ("05 0003 FF00", [coils(3, 1, 1)], [""], "05 00 03 FF 00"),
        ("05 0003 0000", [coils(3, 1, 0)], [""], "05 00 03 00 00"),
        ("06 0003 BEEF", [holding(3, 1, 0xBEEF)], [""], "06 00 03 BE EF"),
        ("0F 0003 0003 01 05", [coils(3, 3, 1, 0, 1)], [""], "0F 00 03 00 03"),
        ("10 0003 0002 04 0001 0002", [holding(3, 2, 1, 2)], [""], "10 00 03 00 02"),
        ("16 0003 00F2 0025", [holding(3), holding(3, 1, 0x17)], ["0012", ""], "16 00 03 00 F2 00 25"),
        ("17 0003 0002 0005 0001 02 0009", [holding(5, 1, 9), holding(3, 2)], ["", "0001 0002"], "17 04 00 01 00 02"),
    ],
)
def test_each_function_is_one_or_two_calls(pdu, calls, results, answer):
    assert Stage().asks(pdu, *results) == (calls, answer)


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [
        ("03 0064 0001", "83 02"),
        ("03 0063 0002", "83 02"),
        ("01 0000 0001", "81 02"),
        ("03 0000 0000", "83 03"),
        ("05 0000 1234", "85 03"),
        ("18 0000", "98 01"),
        ("08 0000 1234", "08 00 00 12 34"),
        ("0B", "0B 00 00 00 00"),
        ("11", "11 06 63 6C 6F 63 6B FF"),
    ],
)
def test_what_needs_no_unit_is_answered_without_it(pdu, answer):
    """Wrong requests, by the specification and by the addresses; diagnostics and identification."""
    assert Stage(areas={Area.HOLDING: ((0, 99),)}).asks(pdu) == ([], answer)


def test_a_profile_counts_before_the_unit_is_asked():
    stage = Stage(MINT)
    assert stage.asks("06 0001 0001") == ([], "86 01")
    assert stage.asks("03 0001 0064") == ([], "83 03")
    assert stage.asks("03 0000 0001") == ([], "83 02")


#: Its holding register 3 takes at most 0x24.
GUARDED = GENERIC.guarding([Point("set point", Area.HOLDING, 3, write="yes", maximum=0x24)])


def test_a_guard_counts_before_the_unit_is_asked():
    assert Stage(GUARDED).asks("06 0003 0025") == ([], "86 03")
    assert Stage(GUARDED).asks("06 0003 0024", "") == ([holding(3, 1, 0x24)], "06 00 03 00 24")


@pytest.mark.parametrize(
    ("before", "writes", "answer"),
    [("0041", [], "96 03"), ("0004", [holding(3, 1, 0x0204)], "16 00 03 FD FF 02 00")],
)
def test_a_guard_sees_what_bits_make_of_their_register_in_one_turn(before, writes, answer):
    low_byte = Point("set point", Area.HOLDING, 3, write="yes", maximum=0x24, bits=(0, 7))
    stage, client = Stage(GENERIC.guarding([low_byte])), Asker()
    request = client.ask("16 0003 FDFF 0200", unit=60)
    request.in_one_turn = 6
    stage.image.submit(request, 0.0)
    stage.end(before)
    assert list(stage.calls) == [holding(3), *writes]
    if writes:
        stage.end("")
    assert client.answers == [answer]


def test_requests_are_carried_out_one_after_the_other_in_the_order_in_which_they_came():
    stage, one, other = Stage(), Asker(), Asker("10.0.0.8:1")
    stage.ask(one, "03 0001 0001")
    stage.ask(other, "06 0001 0009")
    stage.ask(one, "03 0002 0001")
    assert list(stage.calls) == [holding(1)]
    stage.end("0001")
    assert list(stage.calls) == [holding(1), holding(1, 1, 9)]
    assert (one.answers, other.answers) == (["03 02 00 01"], [])
    stage.end("")
    stage.end("0002")
    assert (one.answers, other.answers) == (["03 02 00 01", "03 02 00 02"], ["06 00 01 00 09"])


def test_a_client_that_asks_again_as_it_is_answered_has_no_second_call_at_once():
    stage = Stage()

    class Eager(Asker):
        def answer(self, request, pdu):
            super().answer(request, pdu)
            if len(self.answers) < 3:
                stage.ask(self, "03 0001 0001")

    client = Eager()
    stage.ask(client, "03 0001 0001")
    for number in range(3):
        assert len(stage.calls) == number + 1
        stage.end("0001")
    assert client.answers == ["03 02 00 01"] * 3


def test_nor_do_many_that_are_refused_at_once_nest():
    stage = Stage()

    class Eager(Asker):
        def answer(self, request, pdu):
            super().answer(request, pdu)
            if len(self.answers) < 3000:
                stage.ask(self, "03 0001 0001")

    fail(stage, 3)
    client = Eager()
    stage.ask(client, "03 0001 0001")
    assert client.answers == ["83 0B"] * 3000


def test_diagnostics_of_a_client_wait_for_its_requests():
    stage, client = Stage(), Asker()
    stage.ask(client, "06 0001 0001")
    stage.ask(client, "0B")
    assert client.answers == []
    stage.end("")
    assert client.answers == ["06 00 01 00 01", "0B 00 00 00 01"]


def test_so_many_wait_and_the_next_gets_06():
    stage, waiting, last = Stage(), Asker(), Asker("10.0.0.8:1")
    for _ in range(1 + MOST_WAITING):
        stage.ask(waiting, "03 0001 0001")
    stage.ask(last, "03 0001 0001")
    assert (waiting.answers, last.answers) == ([], ["83 06"])
    assert [type(event) for event in stage.events] == [RequestRefused]
    waiting.gone = True
    stage.ask(last, "03 0002 0001")
    assert len(waiting.answers) == MOST_WAITING  # they make room; that in its turn goes on
    assert last.answers == ["83 06"]


def test_what_a_client_has_asked_that_left_is_not_begun():
    stage, one, gone = Stage(), Asker(), Asker("10.0.0.8:1")
    stage.ask(one, "03 0001 0001")
    stage.ask(gone, "06 0001 0001")
    gone.gone = True
    stage.end("0001")
    assert (list(stage.calls), gone.answers) == ([holding(1)], ["86 06"])


def test_what_has_waited_too_long_gets_06_and_is_never_carried_out():
    stage, one, other = Stage(timeout=0.5), Asker(), Asker("10.0.0.8:1")
    stage.ask(one, "03 0001 0001")
    stage.wait(0.2)
    stage.ask(other, "06 0001 0001")
    stage.wait(0.3)
    assert one.answers == ["83 0B"]
    stage.wait(0.2 - 0.001)
    assert other.answers == []
    stage.wait(0.001)
    assert other.answers == ["86 06"]
    stage.end(b"")
    assert list(stage.calls) == [holding(1)]


def test_a_call_that_is_not_over_in_time_gets_0b_and_is_cancelled_once():
    stage, client = Stage(timeout=0.25), Asker()
    stage.ask(client, "03 0001 0001")
    stage.wait(0.249)
    assert (client.answers, stage.cancelled) == ([], 0)
    stage.wait(0.001)
    assert (client.answers, stage.cancelled) == (["83 0B"], 1)
    assert stage.events == [RequestTimeout("", 60, "clock", 3, 250.0, 250.0, "g.toml:9")]
    stage.wait(10.0)
    assert (client.answers, stage.cancelled) == (["83 0B"], 1)


def test_both_calls_of_a_request_have_one_deadline():
    stage, client = Stage(), Asker()
    stage.ask(client, "17 0003 0001 0005 0001 02 0009")
    stage.wait(0.6)
    stage.end("")
    stage.wait(0.4)
    assert client.answers == ["97 0B"]


def test_while_a_call_goes_on_after_its_deadline_no_other_begins():
    stage, one, other = Stage(), Asker(), Asker("10.0.0.8:1")
    stage.ask(one, "03 0001 0001")
    stage.wait(1.0)
    stage.ask(other, "03 0002 0001")
    stage.wait(0.9)
    assert list(stage.calls) == [holding(1)]
    stage.end("0666")  # too late for anybody
    assert list(stage.calls) == [holding(1), holding(2)]
    stage.end("0002")
    assert (one.answers, other.answers) == (["83 0B"], ["03 02 00 02"])


def test_a_call_that_has_not_begun_is_withdrawn_and_its_request_gets_06():
    stage, client = Stage(), Asker()
    stage.withdraws = True
    stage.ask(client, "06 0001 0001")
    stage.wait(1.0)
    assert client.answers == ["86 06"]
    stage.ask(client, "03 0002 0001")
    assert stage.calls[-1] == holding(2)


def test_a_request_whose_second_call_has_not_begun_may_have_acted():
    stage, client = Stage(), Asker()
    stage.ask(client, "17 0003 0001 0005 0001 02 0009")
    stage.end("")
    stage.withdraws = True
    stage.wait(1.0)
    assert client.answers == ["97 0B"]


@pytest.mark.parametrize(("error", "answer"), [(IllegalAddress("no"), "83 02"), (DeviceFailure("broken"), "83 04")])
def test_an_error_of_the_unit_is_its_answer(error, answer):
    stage = Stage()
    assert stage.asks("03 0001 0001", error) == ([holding(1)], answer)
    (event,) = stage.events
    assert (event.why, event.device, event.code) == (str(error), "clock", answer[3:])
    assert stage.image.breaker.failures == 0


def test_an_error_of_the_first_call_is_the_end_of_the_request():
    assert Stage().asks("17 0003 0001 0005 0001 02 0009", IllegalAddress()) == ([holding(5, 1, 9)], "97 02")


@pytest.mark.parametrize("error", [IllegalAddress("no"), Busy("not now"), LineDown("down"), DeviceFailure("broken")])
def test_an_error_after_a_write_does_not_say_that_nothing_was_written(error):
    stage = Stage()
    calls = [holding(5, 1, 9), holding(3)]
    assert stage.asks("17 0003 0001 0005 0001 02 0009", "", error) == (calls, "97 04")
    assert stage.events[0].why == f"it was written, and not read: {error}"


def fail(stage: Stage, times: int) -> None:
    for _ in range(times):
        stage.ask(Asker(), "03 0001 0001")
        stage.wait(1.0)
        stage.end(b"")


def test_after_three_failures_in_a_row_it_rests_and_is_tried_again():
    stage = Stage()
    fail(stage, 3)
    assert stage.events[-1] == UnitResting("", 60, "clock", 9.0, "g.toml:9")
    begun = len(stage.calls)
    client = Asker()
    stage.ask(client, "03 0001 0001")
    assert (client.answers, len(stage.calls)) == (["83 0B"], begun)
    stage.wait(9.0)
    stage.ask(client, "03 0001 0001")
    stage.end("0001")
    assert client.answers == ["83 0B", "03 02 00 01"]
    assert stage.events[-1] == UnitRecovered("", 60, "clock")
    assert stage.image.breaker.failures == 0


def test_any_answer_between_failures_starts_anew():
    stage = Stage()
    fail(stage, 2)
    stage.asks("03 0001 0001", IllegalAddress())
    fail(stage, 2)
    assert not stage.image.breaker.is_resting(stage.now)


def test_diagnostics_are_answered_while_it_rests():
    stage = Stage()
    fail(stage, 3)
    assert stage.asks("11")[1] == "11 06 63 6C 6F 63 6B FF"


def test_a_unit_that_hangs_rests_too_and_its_clients_need_not_wait():
    """Each request behind the call that does not end is a failure; those that came before its deadline are none."""
    stage, first = Stage(), Asker()
    for _ in range(4):
        stage.ask(first, "03 0001 0001")
    stage.wait(1.0)
    assert (first.answers, stage.image.breaker.failures) == (["83 0B", "83 06", "83 06", "83 06"], 1)
    for failures in (2, 3):
        client = Asker()
        stage.ask(client, "03 0001 0001")
        stage.wait(1.0)
        assert (client.answers, stage.image.breaker.failures) == (["83 06"], failures)
    late = Asker()
    stage.ask(late, "03 0001 0001")
    stage.wait(1.0)
    assert late.answers == ["83 06"]  # still behind the call
    stage.end(b"")
    stage.ask(late, "03 0001 0001")
    assert late.answers == ["83 06", "83 0B"]


def test_a_broadcast_is_carried_out_without_an_answer():
    stage, client = Stage(), Asker()
    Broadcast([Recipient(stage.image)]).submit(client.ask("06 0001 0005", unit=0), 0.0)
    assert (list(stage.calls), client.answers) == ([holding(1, 1, 5)], [])
    stage.end("")
    assert client.answers == [None]


def test_a_broadcast_that_fails_ends_too():
    stage, client = Stage(), Asker()
    Broadcast([Recipient(stage.image)]).submit(client.ask("06 0001 0005", unit=0), 0.0)
    stage.wait(1.0)
    assert client.answers == [None]


def test_closed_it_answers_what_is_open_and_refuses_the_rest():
    stage, present, waiting, late = Stage(), Asker(), Asker("10.0.0.8:1"), Asker("10.0.0.7:1")
    stage.ask(present, "06 0001 0001")
    stage.ask(waiting, "06 0001 0001")
    stage.image.close(stage.now)
    stage.ask(late, "06 0001 0001")
    assert (present.answers, waiting.answers, late.answers) == (["86 0B"], ["86 0A"], ["86 0A"])
    assert (stage.cancelled, stage.wakes_at) == (1, None)
    stage.end("")
    assert len(stage.calls) == 1


def test_closed_before_its_call_has_begun_nothing_was_done():
    stage, client = Stage(), Asker()
    stage.withdraws = True
    stage.ask(client, "06 0001 0001")
    stage.image.close(stage.now)
    assert client.answers == ["86 0A"]


def test_its_writes_have_a_last_writer_and_only_those_that_succeed():
    stage = Stage()
    stage.asks("06 0001 0001", "")
    stage.asks("06 0002 0001", IllegalAddress())
    assert [(write.span.start, write.client) for write in stage.image.last_writes] == [(1, "10.0.0.9:49152")]


def test_its_requests_and_exceptions_are_counted():
    stage = Stage()
    stage.asks("03 0001 0001", "0001")
    stage.asks("03 0001 0001", IllegalAddress())
    stage.asks("03 0001 0000")
    assert (stage.image.counts.requests, stage.image.counts.exceptions) == (3, 2)


def test_all_addresses_cost_no_memory():
    assert all(not table.ranges for table in Stage().image.tables.values())
