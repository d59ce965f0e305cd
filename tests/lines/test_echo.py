"""Adapters that return what they send: announced with `echo = true`, or not."""

import pytest

from gateway.devices.quirks import AddressZeroDevice
from gateway.events import BadFrame, EchoHeard, LateResponse
from gateway.lines.echo import ECHOES
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.line_bench import ASCII, READ, READ_FRAME, REQUEST_TIME, RESPONSE, RESPONSE_FRAME, TIMING, Bench, frame

WRITE = "06 00 01 00 05"
WRITE_FRAME = frame(1, WRITE)
# --- announced: echo = true ---


@pytest.fixture
def announced() -> Bench:
    return Bench(echo=True, virtual=False)


def test_the_response_behind_the_echo_is_the_answer(announced: Bench) -> None:
    announced.ask()
    announced.hear(READ_FRAME + RESPONSE_FRAME)
    assert announced.client.answers == [RESPONSE]
    assert (announced.counts.noise, announced.counts.echoes) == (0, 0)


def test_a_write_is_confirmed_by_its_response_and_not_by_its_echo(announced: Bench) -> None:
    announced.ask(WRITE)
    announced.hear(WRITE_FRAME)
    announced.pass_time(0.1)
    assert announced.client.answers == []
    announced.hear(WRITE_FRAME)
    assert announced.client.answers == [WRITE]


def test_an_echo_alone_is_a_time_out(announced: Bench) -> None:
    announced.ask(WRITE)
    announced.hear(WRITE_FRAME)
    announced.pass_time(0.3)
    assert announced.client.answers == ["86 0B"]
    assert (announced.counts.timeout, announced.counts.bad_frame) == (1, 0)


def test_without_the_echo_nothing_is_an_answer(announced: Bench) -> None:
    announced.ask()
    announced.hear(RESPONSE_FRAME)
    announced.pass_time(0.3)
    assert announced.client.answers == ["83 0B"]


def test_another_clients_copy_stands_for_an_echo_that_was_lost(announced: Bench) -> None:
    """What nobody can detect (ADR 5): where the documents say so, they say what is."""
    announced.ask(WRITE)
    announced.pass_time(0.1)
    announced.hear(WRITE_FRAME)
    announced.hear(WRITE_FRAME)
    assert announced.client.answers == [WRITE]


def test_the_echo_of_a_broadcast_is_nothing_to_the_next_request(announced: Bench) -> None:
    announced.broadcast(WRITE)
    announced.hear(frame(0, WRITE))
    announced.ask(WRITE)
    announced.pass_time(0.2)
    announced.hear(WRITE_FRAME)
    assert announced.client.answers == [None]
    announced.hear(WRITE_FRAME)
    assert announced.client.answers == [None, WRITE]


def test_noise_before_the_echo_does_not_lose_the_answer(announced: Bench) -> None:
    announced.ask()
    announced.hear("55" + READ_FRAME + RESPONSE_FRAME)
    assert announced.client.answers == [RESPONSE]
    assert announced.counts.noise == 1


def test_another_clients_request_before_the_echo_makes_the_answer_ambiguous(announced: Bench) -> None:
    announced.ask()
    announced.hear(frame(1, "03 00 30 00 01") + READ_FRAME + RESPONSE_FRAME)
    assert announced.client.answers == ["83 0B"]


# --- not announced ---


@pytest.fixture
def real() -> Bench:
    """A real serial port without `echo = true`."""
    return Bench(virtual=False)


def test_nothing_that_comes_before_the_request_has_left_is_a_response(real: Bench) -> None:
    real.ask(WRITE)
    real.pass_time(REQUEST_TIME - 1e-6)
    real.hear(WRITE_FRAME)
    assert real.client.answers == []
    real.pass_time(0.3)
    assert real.client.answers == ["86 0B"]


def test_a_response_that_comes_when_the_request_has_left_is_one(real: Bench) -> None:
    real.ask(WRITE)
    real.pass_time(REQUEST_TIME + 1e-6)
    real.hear(WRITE_FRAME)
    assert real.client.answers == [WRITE]
    assert real.told(EchoHeard) == []


def test_an_echo_is_told_once_and_then_its_kind_of_write_gets_0b(real: Bench) -> None:
    for _ in range(ECHOES + 2):
        real.ask()
        real.hear(READ_FRAME)
        real.pass_time(0.02)
        real.hear(RESPONSE_FRAME)
        real.pass_time(0.01)
    assert real.client.answers == [RESPONSE] * (ECHOES + 2)
    assert [(told.line, told.source) for told in real.told(EchoHeard)] == [("hall-a", "")]
    assert real.counts.echoes == ECHOES + 2
    real.client.answers.clear()
    real.written.clear()
    for pdu in (WRITE, "05 00 01 FF 00", "08 00 00 12 34", "16 00 01 00 F2 00 25", "41 01"):
        real.ask(pdu)
    assert real.client.answers == ["86 0B", "85 0B", "88 0B", "96 0B", "C1 0B"]
    assert real.written == []


@pytest.mark.parametrize("pdu", [READ, "01 00 01 00 01", "0F 00 01 00 02 01 03", "10 00 01 00 01 02 00 07"])
def test_what_no_echo_can_answer_goes_on(real: Bench, pdu: str) -> None:
    hear_an_echo(real)
    real.ask(pdu)
    assert real.written == [frame(1, pdu)]


def test_a_broadcast_needs_no_answer_so_it_goes_on(real: Bench) -> None:
    hear_an_echo(real)
    real.broadcast(WRITE)
    assert real.written == [frame(0, WRITE)]


def test_a_read_of_bits_that_its_echo_would_answer_gets_0b_too(real: Bench) -> None:
    """01 03 20 00 18: 24 coils from 0320 on; as a response: 3 bytes of coils, 20 00 18."""
    hear_an_echo(real)
    real.ask("01 03 20 00 18")
    assert real.client.answers == ["81 0B"]


def test_a_write_that_waited_when_the_echo_was_heard_gets_0b_when_its_turn_comes(real: Bench) -> None:
    real.ask()
    real.ask(WRITE)
    real.hear(READ_FRAME)
    real.pass_time(0.02)
    real.hear(RESPONSE_FRAME)
    real.pass_time(0.01)
    assert real.client.answers == [RESPONSE, "86 0B"]
    assert real.written == [READ_FRAME]


def test_the_echo_of_a_write_never_confirms_it(real: Bench) -> None:
    real.ask(WRITE)
    real.hear(WRITE_FRAME)
    real.pass_time(0.3)
    assert real.client.answers == ["86 0B"]
    assert len(real.told(EchoHeard)) == 1
    real.ask(WRITE)
    assert real.client.answers == ["86 0B", "86 0B"]


def test_an_echo_that_is_cut_by_the_end_of_its_request_is_one(real: Bench) -> None:
    """An adapter hands over what it has, not whole frames."""
    real.ask(WRITE)
    real.hear(WRITE_FRAME[:12])
    real.pass_time(REQUEST_TIME + 1e-6)
    real.hear(WRITE_FRAME[12:])
    real.pass_time(0.02)
    assert real.client.answers == []
    real.hear(WRITE_FRAME)
    assert real.client.answers == [WRITE]
    assert len(real.told(EchoHeard)) == 1


@pytest.mark.parametrize("pdu", [READ, WRITE])
def test_what_had_begun_when_the_request_was_sent_is_no_echo(real: Bench, pdu: str) -> None:
    """Another client has sent it, and the adapter has handed it over in two pieces."""
    whole = bytes.fromhex(real.frame(1, pdu))
    real.hear(whole[:3].hex())
    real.ask(pdu)
    real.pass_time(0.003)
    assert real.written == [real.frame(1, pdu)]
    real.hear(whole[3:].hex())
    real.pass_time(1.0)
    assert (real.told(EchoHeard), real.client.answers) == ([], [f"8{pdu[1]} 0B"])


def test_several_copies_that_had_begun_before_their_requests_are_no_echo(real: Bench) -> None:
    copy = bytes.fromhex(READ_FRAME)
    for _ in range(ECHOES + 1):
        real.hear(copy[:3].hex())
        real.ask()
        real.pass_time(0.03)
        real.hear(copy[3:].hex())
        real.hear(2 * RESPONSE_FRAME)
        real.pass_time(5.0)
    assert real.told(EchoHeard) == []


@pytest.mark.parametrize("later", [0.002, 0.05])
def test_an_echo_that_comes_later_is_one_when_it_came_to_several_requests_in_a_row(real: Bench, later: float) -> None:
    """Another client's request may be a copy of ours; hardly of each of ours."""
    for _ in range(ECHOES):
        assert real.told(EchoHeard) == []
        real.ask()
        real.pass_time(REQUEST_TIME + later)
        real.hear(READ_FRAME)
        real.hear(RESPONSE_FRAME)
        real.pass_time(5.0)
    real.ask()
    assert real.client.answers == [RESPONSE] * ECHOES
    assert len(real.told(EchoHeard)) == 1


def test_copies_now_and_then_are_no_echo(real: Bench) -> None:
    for copies in (1, 1, 1, 1, 0, 1, 1, 1, 1, 0):
        real.ask()
        real.pass_time(0.05)
        real.hear(READ_FRAME * copies + RESPONSE_FRAME)
        real.pass_time(5.0)
    real.ask()
    assert real.told(EchoHeard) == []


def test_a_known_echo_is_no_other_clients_request_however_late_it_comes(real: Bench) -> None:
    hear_an_echo(real)
    for pdu in (READ, "03 00 20 00 01", READ):
        real.ask(pdu)
        real.pass_time(0.05)
        real.hear(frame(1, pdu) + RESPONSE_FRAME)
        real.pass_time(0.01)
    assert real.client.answers == [RESPONSE] * 3


def test_a_second_copy_is_another_clients_request_though_the_adapter_echoes(announced: Bench) -> None:
    announced.ask()
    announced.pass_time(0.05)
    announced.hear(READ_FRAME + READ_FRAME + RESPONSE_FRAME)
    announced.pass_time(0.01)
    announced.ask("03 00 20 00 01")
    announced.hear(frame(1, "03 00 20 00 01"))
    announced.pass_time(0.05)
    announced.hear(frame(1, "03 02 DE AD"))
    assert announced.client.answers == [RESPONSE, "83 0B"]


@pytest.mark.parametrize("behind", [0.97, 1.5])
def test_a_copy_that_another_client_had_the_time_to_send_is_its_request(behind: float) -> None:
    """At 115200 baud that is less than an adapter holds an echo back."""
    fast = LineTiming("rtu", 115200, CharacterFormat.parse("8E1"))
    bench = Bench(virtual=False, timing=fast)
    bench.ask()
    bench.pass_time((1 + behind) * 8 * fast.character)
    bench.hear(READ_FRAME)
    bench.hear(RESPONSE_FRAME)
    bench.pass_time(0.01)
    bench.ask("03 00 20 00 01")
    bench.pass_time(0.003)
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE, "83 0B"]


def test_writes_whose_responses_come_twice_are_confirmed_by_an_echo_that_comes_late(real: Bench) -> None:
    """The first one cannot be told from the response; what comes behind it tells, when that has happened often."""
    for _ in range(ECHOES + 1):
        real.ask(WRITE)
        real.pass_time(REQUEST_TIME + 0.012)
        real.hear(WRITE_FRAME)
        real.pass_time(0.01)
        real.hear(WRITE_FRAME)
        real.pass_time(0.5)
    real.ask(WRITE)
    assert len(real.told(EchoHeard)) == 1
    assert real.client.answers[-1] == "86 0B"


def test_an_announced_echo_is_not_told_though_parity_bits_hide_it() -> None:
    announced = Bench(echo=True, virtual=False, timing=ASCII)
    announced.ask()
    announced.hear(bytes(each | 0x80 for each in bytes.fromhex(announced.frame(1, READ))).hex())
    announced.pass_time(1.0)
    assert announced.told(EchoHeard) == []


def test_an_echo_alone_is_no_broken_frame_so_it_is_not_sent_again() -> None:
    real = Bench(virtual=False, retries=1)
    real.ask()
    real.hear(READ_FRAME)
    real.pass_time(0.3)
    assert real.written == [READ_FRAME]


def test_two_copies_of_a_writes_response_behind_noise_are_no_echo(real: Bench) -> None:
    """They came when the request had left. To refuse all writes of the line from then on would be the greater harm."""
    real.ask(WRITE)
    real.pass_time(0.02)
    real.hear("55" + WRITE_FRAME + WRITE_FRAME)
    assert real.client.answers == [WRITE]
    assert real.told(EchoHeard) == []


def test_what_comes_before_the_request_has_left_does_not_shorten_the_silence_behind_it() -> None:
    real = Bench(virtual=False, gap=0.5)
    real.ask()
    real.ask(unit=2)
    real.hear("55")
    real.pass_time(REQUEST_TIME + 0.5 - 1e-6)
    assert len(real.written) == 1
    real.pass_time(2e-6)
    assert len(real.written) == 2


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
def test_a_virtual_port_carries_bytes_at_once_so_anything_may_be_the_response(timing: object) -> None:
    bench = Bench(timing=timing)
    bench.ask(WRITE)
    bench.hear(bench.frame(1, WRITE))
    assert bench.client.answers == [WRITE]
    bench.pass_time(0.01)
    bench.ask()
    bench.hear(bench.frame(1, READ) + bench.frame(1, RESPONSE))
    assert bench.client.answers == [WRITE, RESPONSE]
    assert bench.told(EchoHeard) == []
    assert bench.counts.echoes == 0


def test_an_ascii_echo_is_heard_too() -> None:
    real = Bench(virtual=False, timing=ASCII)
    real.ask()
    real.hear(real.frame(1, READ))
    real.pass_time(0.05)
    real.hear(real.frame(1, RESPONSE))
    assert real.client.answers == [RESPONSE]
    assert len(real.told(EchoHeard)) == 1


def test_a_lone_device_does_not_take_the_echo_of_its_question() -> None:
    real = Bench(virtual=False)
    real.devices[0] = AddressZeroDevice(real.device(unit=0).settings, real.line)
    real.ask(unit=0)
    real.hear(frame(0, READ))
    real.pass_time(0.02)
    real.hear(frame(77, RESPONSE))
    assert real.client.answers == [RESPONSE]


@pytest.mark.parametrize(("heard", "is_echo"), [(READ_FRAME, True), (READ_FRAME + " 00", False), ("55 AA", False)])
def test_on_a_virtual_port_a_broken_answer_says_if_it_is_the_request_itself(heard: str, is_echo: bool) -> None:
    bench = Bench()
    bench.ask(READ)
    bench.hear(heard)
    bench.pass_time(1.0)
    (told,) = bench.told(BadFrame)
    assert ("does the adapter echo?" in told.reason) == is_echo


def hear_an_echo(bench: Bench) -> None:
    """A read's; its answer follows."""
    bench.ask()
    bench.hear(READ_FRAME)
    bench.pass_time(0.02)
    bench.hear(RESPONSE_FRAME)
    bench.pass_time(0.01)
    bench.client.answers.clear()
    bench.written.clear()


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
@pytest.mark.parametrize(
    ("theirs", "ours", "their_answer", "exception"),
    [
        ("01 00 00 00 18", "01 03 10 00 18", "01 03 AA AA AA", "81 0B"),
        ("06 00 30 00 07", "06 00 30 00 07", "86 04", "86 0B"),
    ],
    ids=["coils", "write"],
)
def test_an_announced_echo_answers_no_other_client(
    timing: LineTiming, theirs: str, ours: str, their_answer: str, exception: str
) -> None:
    bench = Bench(timing=timing, virtual=False, echo=True)
    bench.device(1)
    bench.respond(theirs)
    bench.pass_time(0.05)
    bench.ask(ours)
    bench.pass_time(0.03)
    bench.hear(bench.written[-1])
    bench.pass_time(0.01)
    bench.respond(their_answer)
    assert bench.client.answers == [exception]


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
def test_the_echo_of_listen_only_is_no_late_response(timing: LineTiming) -> None:
    bench = Bench(timing=timing, virtual=False, echo=True)
    bench.ask("08 00 04 00 00")
    bench.pass_time(0.02)
    bench.hear(bench.written[-1])
    assert bench.client.answers == [None]
    assert bench.told(LateResponse) == []
    assert bench.line.ledger.count_late(bench.now) == 1
