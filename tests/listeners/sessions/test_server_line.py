"""A line where we are a server: what is answered, when, and what never is."""

from dataclasses import asdict, replace

import pytest

from gateway.errors import IllegalFunction, LineDown, ResponseTimeout, WaitedTooLong
from gateway.events import AnswerWithheld
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.server_bench import ASCII, LATENCY, RTU, ServerBench
from kit.waiting import Waiting

READ = "03 00 00 00 02"
RESPONSE = bytes.fromhex("03 04 45 9C 3D 51")
OTHER = "03 00 10 00 01"
WRITE = "06 00 01 00 05"

BOTH = pytest.mark.parametrize("timing", [RTU, ASCII], ids=["rtu", "ascii"])


def test_a_client_that_sends_something_else_has_given_its_request_up() -> None:
    bench = ServerBench()
    waiting = Waiting(bench.ask(READ))
    bench.pass_time(0.1)
    assert not waiting.is_given_up
    bench.ask(OTHER)
    assert waiting.is_given_up


@BOTH
class TestOnBothKindsOfLine:
    def test_a_request_for_our_unit_is_answered(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        request = bench.ask(READ)
        assert (request.unit, request.pdu, request.caller.client) == (41, bytes.fromhex(READ), "panel")
        assert request.caller.host == ""
        assert request.origin.wants(request)
        bench.pass_time(0.1)
        request.respond(RESPONSE)
        assert bench.take_written() == [bench.frame(41, RESPONSE.hex())]
        assert bench.session.is_idle

    def test_other_units_are_heard_and_not_answered(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        assert bench.ask(READ, unit=7) is None
        bench.pass_time(2.0)
        assert (bench.counts.foreign_frames, bench.take_written()) == (1, [])

    def test_a_broadcast_goes_on_and_nobody_answers(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        write, read = bench.ask(WRITE, unit=0), bench.ask(READ, unit=0)
        assert write.origin.wants(write)
        write.end()
        read.fail(IllegalFunction())
        bench.pass_time(2.0)
        assert (bench.counts.broadcasts, bench.counts.requests, bench.take_written()) == (2, 0, [])

    def test_a_broken_frame_gets_silence(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        data = bytearray(bench.frame(41, READ))
        data[-3] ^= 1
        bench.hear(bytes(data))
        bench.pass_time(2.0)
        assert (bench.asked, bench.take_written(), bench.counts.noise) == ([], [], 1)

    def test_a_request_with_a_wrong_parity_bit_gets_silence(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        frame = bench.frame(41, WRITE)
        bench.hear(frame[:-3])
        bench.session.received(frame[-3:-2], bench.now, damaged=True)
        bench.hear(frame[-2:])
        bench.pass_time(2.0)
        assert (bench.asked, bench.take_written()) == ([], [])
        assert bench.counts.noise

    def test_the_request_behind_a_broken_frame_is_answered(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        bench.hear(bench.frame(41, READ)[:-2])
        bench.pass_time(0.5)
        assert bench.ask(OTHER) is not None

    def test_an_exception_is_passed_on(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        bench.ask(READ).fail(ResponseTimeout())
        bench.pass_time(0.1)
        assert bench.take_written() == [bench.frame(41, "83 0B")]
        assert (bench.counts.responses, bench.counts.exceptions) == (1, 1)

    def test_a_frame_that_is_an_exception_is_nobodys_request(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        bench.hear(bench.frame(41, "83 02"))
        bench.pass_time(0.1)
        assert (bench.asked, bench.counts.foreign_frames) == ([], 1)

    def test_an_answer_that_comes_too_late_is_withheld(self, timing: LineTiming) -> None:
        bench = ServerBench(timing, answer_within=0.3)
        request = bench.ask(READ)
        bench.pass_time(0.29)
        assert request.origin.wants(request)
        bench.pass_time(0.02)
        assert not request.origin.wants(request)
        request.respond(RESPONSE)
        bench.pass_time(1.0)
        assert bench.take_written() == []
        assert bench.counts.too_late == 1
        assert bench.told(AnswerWithheld) == [
            AnswerWithheld("panel", 41, 3, 300.0, "it was not available within answer_within", "a.toml:7")
        ]

    @pytest.mark.parametrize(
        ("unit", "pdu"),
        [(41, READ), (41, OTHER), (42, READ), (7, READ), (0, WRITE), (7, "03 02 00 01"), (7, "83 02")],
        ids=[
            *("the same again", "another request", "our other unit", "another server", "a broadcast"),
            *("an answer of another server", "an exception of another server"),
        ],
    )
    def test_no_answer_after_another_frame(self, timing: LineTiming, unit: int, pdu: str) -> None:
        """The client would take it for the answer to that."""
        bench = ServerBench(timing)
        first = bench.ask(READ)
        bench.pass_time(0.1)
        bench.ask(pdu, unit)
        assert not first.origin.wants(first)
        first.respond(bytes.fromhex("03 04 00 00 00 01"))
        bench.pass_time(0.1)
        assert bench.take_written() == []
        assert bench.counts.overtaken == 1
        assert [event.elapsed_ms for event in bench.told(AnswerWithheld)] == [100.0]

    def test_the_last_request_is_answered(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        bench.ask(READ)
        bench.pass_time(0.1)
        bench.ask(OTHER, 42).respond(b"\x03\x02\x00\x07")
        bench.pass_time(0.1)
        assert bench.take_written() == [bench.frame(42, "03 02 00 07")]

    def test_of_requests_that_are_read_at_once_only_the_last_one_is_carried_out(self, timing: LineTiming) -> None:
        """Their client has given up the others; a broadcast it never awaits."""
        bench = ServerBench(timing)
        bench.at_once = RESPONSE
        bench.hear(bench.frame(41, WRITE) * 3 + bench.frame(0, WRITE) + bench.frame(42, READ))
        bench.pass_time(0.1)
        assert [request.unit for request in bench.asked] == [0, 42]
        assert bench.take_written() == [bench.frame(42, RESPONSE.hex())]
        assert (bench.counts.requests, bench.counts.overtaken, len(bench.told(AnswerWithheld))) == (4, 3, 3)

    def test_one_behind_which_another_begins_is_not_carried_out(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        bench.hear(bench.frame(41, WRITE) + bench.frame(41, WRITE)[:4])
        assert (bench.asked, bench.counts.overtaken) == ([], 1)

    @pytest.mark.parametrize("size", [1, 3])
    def test_what_is_right_behind_a_request_is_no_glitch_if_the_gateway_stood_still(
        self, timing: LineTiming, size: int
    ) -> None:
        """It may be the beginning of the next request, which the client sends long after that one."""
        bench = ServerBench(timing)
        bench.at_once = RESPONSE
        later = bench.frame(42, READ)
        bench.session.received(bench.frame(41, WRITE) + later[:size], bench.now, since=bench.now - 0.5)
        assert (bench.take_written(), bench.asked, bench.counts.overtaken) == ([], [], 1)
        bench.pass_time(0.002)
        bench.hear(later[size:])
        bench.pass_time(0.1)
        assert bench.take_written() == [bench.frame(42, RESPONSE.hex())]

    def test_no_answer_after_the_beginning_of_another_frame(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        request = bench.ask(READ)
        bench.pass_time(0.1)
        bench.hear(bench.frame(41, OTHER)[:1])
        request.respond(RESPONSE)
        bench.pass_time(2.0)
        assert (bench.take_written(), bench.counts.overtaken) == ([], 1)

    def test_no_answer_after_a_broken_frame(self, timing: LineTiming) -> None:
        """The client may have asked something else."""
        bench = ServerBench(timing)
        broken = bytes((bench.frame(41, OTHER)[0] ^ 4,)) + bench.frame(41, OTHER)[1:]
        bench.at_once = RESPONSE
        bench.hear(bench.frame(41, READ) + broken)
        bench.pass_time(2.0)
        assert (bench.take_written(), bench.counts.overtaken) == ([], 1)

    @pytest.mark.parametrize("glitch", [b"\x00", b"\xff\x00\xff"])
    def test_what_switching_the_line_leaves_does_no_harm(self, timing: LineTiming, glitch: bytes) -> None:
        bench = ServerBench(timing)
        bench.at_once = RESPONSE
        bench.hear(glitch + bench.frame(41, READ) + glitch)
        bench.pass_time(0.1)
        assert bench.take_written() == [bench.frame(41, RESPONSE.hex())]

    def test_a_glitch_that_the_adapter_brings_later_does_no_harm(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        request = bench.ask(READ)
        bench.pass_time(0.004)
        bench.hear(b"\x00")
        bench.pass_time(0.5)
        request.respond(RESPONSE)
        assert bench.take_written() == [bench.frame(41, RESPONSE.hex())]

    def test_a_lost_port_drops_the_request(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        request = bench.ask(READ)
        bench.session.port_down()
        assert not request.origin.wants(request)
        request.respond(RESPONSE)
        bench.plug()
        bench.pass_time(2.0)
        assert bench.take_written() == []
        assert bench.ask(READ) is not None

    def test_what_a_closing_port_still_delivers_is_nobodys_request(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        bench.session.port_down()
        assert bench.ask(READ) is None
        bench.pass_time(2.0)

    def test_after_the_order_to_finish_only_what_is_under_way_is_answered(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        request = bench.ask(READ)
        bench.session.finish()
        request.respond(RESPONSE)
        bench.pass_time(0.1)
        assert len(bench.take_written()) == 1
        assert bench.ask(READ) is None

    @pytest.mark.parametrize("error", [ResponseTimeout, LineDown, WaitedTooLong])
    def test_a_failure_can_be_kept_silent(self, timing: LineTiming, error: type) -> None:
        bench = ServerBench(timing, on_failure="silent")
        bench.ask(READ).fail(error())
        bench.pass_time(0.1)
        assert (bench.take_written(), bench.counts.silent, bench.session.is_idle) == ([], 1, True)

    def test_what_the_device_itself_says_is_never_kept_silent(self, timing: LineTiming) -> None:
        bench = ServerBench(timing, on_failure="silent")
        bench.ask(READ).respond(b"\x83\x02")
        bench.pass_time(0.1)
        assert bench.take_written() == [bench.frame(41, "83 02")]

    @pytest.mark.parametrize("pdu", [WRITE, "03 04 45 9C 3D 51", "83 02", "41 07", "10 00 01 00 02", "01 03 00 00 08"])
    def test_an_echo_of_the_response_is_stripped(self, timing: LineTiming, pdu: str) -> None:
        bench = ServerBench(timing, echo=True)
        bench.at_once = bytes.fromhex(pdu)
        bench.ask(WRITE)
        bench.pass_time(0.1)
        (written,) = bench.take_written()
        bench.hear(written[:3])
        bench.hear(written[3:])
        bench.pass_time(0.1)
        assert (len(bench.asked), bench.counts.echoes, bench.counts.noise) == (1, 1, 0)
        bench.ask(WRITE)
        assert len(bench.asked) == 2

    @pytest.mark.parametrize("pdu", [WRITE, "03 04 45 9C 3D 51", "83 02"])
    def test_the_request_that_is_glued_to_an_echo_is_heard(self, timing: LineTiming, pdu: str) -> None:
        bench = ServerBench(timing, echo=True)
        bench.at_once = bytes.fromhex(pdu)
        bench.ask(WRITE)
        bench.pass_time(0.1)
        bench.hear(bench.take_written()[0] + bench.frame(42, READ))
        assert [(request.unit, request.pdu.hex()) for request in bench.asked[1:]] == [(42, "0300000002")]

    def test_a_lost_echo_costs_no_request(self, timing: LineTiming) -> None:
        bench = ServerBench(timing, echo=True)
        bench.at_once = RESPONSE
        for _ in range(2):
            bench.ask(READ)
            bench.pass_time(0.1)
        assert len(bench.take_written()) == 2

    def test_it_says_what_it_does(self, timing: LineTiming) -> None:
        bench = ServerBench(timing)
        assert repr(bench.session) == "<SerialSession panel listening>"
        request = bench.ask(READ)
        assert repr(bench.session) == f"<SerialSession panel {request!r}>"
        bench.session.port_down()
        assert repr(bench.session) == "<SerialSession panel down>"


# --- silence ---


@pytest.mark.parametrize(
    ("settings", "silence"),
    [({}, 3.5 * 11 / 19200), ({"idle_chars": 4.5}, 4.5 * 11 / 19200), ({"gap": 0.02}, 0.02), ({"gap": 0.0}, 0.0)],
    ids=["t3.5", "V80", "as the config says", "none"],
)
def test_an_rtu_response_follows_a_silence(settings: dict[str, float], silence: float) -> None:
    bench = ServerBench(**settings)
    bench.at_once = RESPONSE
    asked_at = bench.now
    bench.ask(READ)
    bench.pass_time(0.1)
    assert bench.last_written_at == pytest.approx(asked_at + silence)


def test_an_ascii_response_needs_none() -> None:
    bench = ServerBench(ASCII)
    bench.at_once = RESPONSE
    bench.ask(READ)
    assert bench.take_written() == [b":290304459C3D5161\r\n"]


def test_an_answer_waits_until_what_is_heard_has_ended() -> None:
    """It could be the next request of the client."""
    bench = ServerBench()
    asked_at = bench.now
    request = bench.ask(READ)
    bench.pass_time(0.001)
    bench.hear(b"\x00")
    bench.pass_time(0.004)
    request.respond(RESPONSE)
    bench.session.tick(bench.now)  # the driver looks more often than the session needs
    bench.pass_time(1.0)
    assert bench.last_written_at == pytest.approx(asked_at + 0.001 + RTU.t35 + LATENCY)


def test_an_answer_that_finds_no_silence_in_time_is_withheld() -> None:
    bench = ServerBench(gap=0.5, answer_within=0.4)
    bench.at_once = RESPONSE
    bench.ask(READ)
    bench.pass_time(2.0)
    assert (bench.take_written(), bench.counts.too_late) == ([], 1)


def test_the_next_response_waits_for_the_one_before_to_leave() -> None:
    slow = LineTiming("rtu", 1200, CharacterFormat.parse("8E1"))
    bench = ServerBench(slow)
    bench.at_once = RESPONSE
    bench.ask(READ)
    bench.pass_time(slow.t35)
    first_at = bench.last_written_at
    bench.ask(READ)
    bench.pass_time(1.0)
    assert bench.last_written_at == pytest.approx(first_at + slow.frame(len(RESPONSE)) + slow.t35)


# --- RTU: other servers on the line ---


def test_a_request_of_an_unknown_function_ends_by_silence() -> None:
    bench = ServerBench()
    assert bench.ask("41 01 02") is None
    bench.pass_time(0.1)
    bench.asked[0].respond(b"\x41\x07")
    assert bench.take_written() == [bench.frame(41, "41 07")]


def test_half_a_request_is_forgotten_when_the_port_goes() -> None:
    bench = ServerBench()
    bench.hear(bench.frame(41, "41 01 02"))
    bench.session.port_down()
    bench.pass_time(1.0)
    assert (bench.asked, bench.session.deadline()) == ([], None)


def test_a_response_of_another_server_glued_to_a_request_for_us() -> None:
    bench = ServerBench()
    bench.ask("03 00 00 00 08", unit=7)
    bench.pass_time(0.01)
    bench.hear(bench.frame(7, "03 10" + "29 03 00 00 00 02 D4 23" * 2) + bench.frame(41, READ))
    assert [(request.unit, request.pdu.hex()) for request in bench.asked] == [(41, "0300000002")]
    assert bench.counts.foreign_frames == 2


def test_noise_between_silences_is_counted_once_each() -> None:
    bench = ServerBench()
    for _ in range(3):
        bench.hear(bytes(range(100, 130)))
        bench.pass_time(0.1)
    assert asdict(bench.counts) == {**dict.fromkeys(asdict(bench.counts), 0), "noise": 3}


def test_it_serves_other_units_from_one_request_to_the_next() -> None:
    bench = ServerBench()
    asked = bench.ask(READ)
    bench.session.adopt(replace(bench.settings, serves=frozenset({7})))
    asked.respond(b"\x83\x02")
    bench.pass_time(0.1)
    assert bench.take_written() == [bench.frame(41, "83 02")]
    assert bench.ask(READ) is None
    bench.pass_time(0.1)
    assert bench.ask(READ, unit=7) is not None
