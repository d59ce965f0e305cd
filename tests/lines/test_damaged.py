"""An answer with a wrong check sum ends its transaction, and no other one waits for it."""

import pytest

from gateway.events import BadFrame, UnitResting
from kit.asker import Asker
from kit.line_bench import ASCII, LATENCY, LIMIT, READ, REQUEST_TIME, RESPONSE, TIMING, Bench
from kit.noise import flipped

OTHER = "03 00 20 00 01"


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def bench(request) -> Bench:
    return Bench(timing=request.param)


def damaged(bench: Bench, pdu: str = RESPONSE, unit: int = 1, bit: int = 2) -> str:
    """The answer with one bit of its check sum turned."""
    frame = bytes.fromhex(bench.frame(unit, pdu))
    digits = 3 if bench.settings.timing.mode == "ascii" else 1
    return flipped(frame, 8 * (len(frame) - digits) + bit).hex()


def silence(bench: Bench) -> float:
    return bench.settings.frame_end + LATENCY


def answer_badly(bench: Bench) -> None:
    bench.pass_time(REQUEST_TIME + 0.001)
    bench.hear(damaged(bench))


def test_it_ends_with_the_silence_behind_it(bench: Bench) -> None:
    bench.ask()
    answer_badly(bench)
    bench.pass_time(silence(bench) - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["83 0B"]
    (event,) = bench.told(BadFrame)
    assert event.reason == "this is the answer, and its check sum is wrong"


def test_of_twelve_reads_it_costs_one(bench: Bench) -> None:
    for number in range(12):
        bench.ask(f"03 00 {number:02X} 00 01")
    answer_badly(bench)
    for _ in range(11):
        bench.pass_time(silence(bench) + 1e-3)
        bench.respond()
    assert bench.client.answers == ["83 0B"] + [RESPONSE] * 11


def test_an_exception_too(bench: Bench) -> None:
    bench.ask()
    bench.hear(damaged(bench, "83 02"))
    bench.pass_time(silence(bench) + 1e-6)
    assert bench.client.answers == ["83 0B"]
    bench.ask(OTHER)
    assert len(bench.written) == 2


WRITES = [(f"06 00 {number:02X} 00 05", f"06 00 {number:02X} 00 05") for number in range(12)]
COILS = [(f"01 00 {number:02X} 00 18", "01 03 AA BB CC") for number in range(12)]


@pytest.mark.parametrize("exchanges", [WRITES, COILS], ids=["writes", "24 coils"])
def test_also_if_the_answer_has_the_size_of_a_request(bench: Bench, exchanges: list[tuple[str, str]]) -> None:
    for asked, _ in exchanges:
        bench.ask(asked)
    bench.pass_time(REQUEST_TIME + 0.001)
    bench.hear(damaged(bench, exchanges[0][1]))
    for _, response in exchanges[1:]:
        bench.pass_time(silence(bench) + 1e-3)
        bench.respond(response)
    assert bench.client.answers[0][3:] == "0B"
    assert bench.client.answers[1:] == [response for _, response in exchanges[1:]]
    assert bench.line.ledger.count_late(bench.now) == 0


@pytest.mark.parametrize(("asked", "response"), [WRITES[0], COILS[0]], ids=["write", "24 coils"])
@pytest.mark.parametrize("is_copy", [False, True], ids=["another request", "a copy"])
def test_not_if_another_client_was_ever_heard_that_may_have_sent_it(
    bench: Bench, asked: str, response: str, is_copy: bool
) -> None:
    bench.asks(asked)
    bench.respond(asked if is_copy else "03 00 30 00 01")
    bench.pass_time(3600.0)
    bench.client.answers.clear()
    bench.ask(asked)
    bench.hear(damaged(bench, response))
    assert not is_over(bench)
    bench.pass_time(LIMIT + 0.1)
    assert bench.line.ledger.count_late(bench.now) == 1


def test_nor_where_an_echo_is_configured(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, echo=True)
    bench.ask(WRITES[0][0])
    bench.hear(bench.written[-1])
    bench.hear(damaged(bench, WRITES[0][1]))
    assert not is_over(bench)


@pytest.mark.parametrize("asked", ["11", "2B 0E 04 00", "41 00 01"])
def test_an_exception_to_a_request_whose_answer_has_no_known_size(bench: Bench, asked: str) -> None:
    bench.ask(asked)
    exception = f"{int(asked[:2], 16) | 0x80:02X}"
    bench.hear(damaged(bench, f"{exception} 02"))
    bench.pass_time(silence(bench) + 1e-6)
    assert bench.client.answers == [f"{exception} 0B"]
    assert bench.line.ledger.count_late(bench.now) == 0


def test_the_same_function_of_the_unit_goes_on_and_the_unit_does_not_rest(bench: Bench) -> None:
    for _ in range(5):
        bench.ask()
        answer_badly(bench)
        bench.pass_time(silence(bench) + 1e-3)
    assert len(bench.written) == 5
    assert bench.line.ledger.count_late(bench.now) == 0
    assert bench.told(UnitResting) == []


def test_a_read_is_repeated_at_once(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, retries=1)
    bench.ask()
    bench.ask(OTHER, client=Asker("10.0.0.10:1"))
    answer_badly(bench)
    bench.pass_time(silence(bench) + 1e-6)
    assert bench.written == [bench.frame(1, READ)] * 2
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def test_a_write_is_not(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, retries=1)
    bench.ask("10 00 01 00 01 02 00 05")
    bench.hear(damaged(bench, "10 00 01 00 01"))
    bench.pass_time(silence(bench) + 1e-6)
    assert bench.client.answers == ["90 0B"]
    assert len(bench.written) == 1


# --- what is not it ---


def is_over(bench: Bench) -> bool:
    """Whether the transaction ends with the silence, and before its limit."""
    bench.pass_time(silence(bench) + 1e-3)
    return bool(bench.client.answers)


def test_not_while_bytes_come(bench: Bench) -> None:
    bench.ask()
    bench.hear(damaged(bench))
    bench.pass_time(silence(bench) - 1e-3)
    bench.hear("55")
    assert not is_over(bench)
    bench.pass_time(LIMIT + 0.1)
    assert bench.client.answers == ["83 0B"]
    assert bench.line.ledger.count_late(bench.now) == 1


def test_not_when_the_right_answer_follows(bench: Bench) -> None:
    bench.ask()
    bench.hear(damaged(bench))
    bench.pass_time(silence(bench) - 1e-3)
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def test_not_behind_noise(bench: Bench) -> None:
    bench.ask()
    bench.hear("55")
    bench.hear(damaged(bench))
    assert not is_over(bench)


def test_not_with_another_beginning_or_size(bench: Bench) -> None:
    for other in (damaged(bench, unit=2), damaged(bench, "04 02 01 10"), damaged(bench, "03 04 00 01 00 02")):
        bench = Bench(timing=bench.settings.timing)
        bench.ask()
        bench.hear(other)
        assert not is_over(bench)


def test_not_while_another_answer_is_late(bench: Bench) -> None:
    """It may be that one, with a damaged unit identifier."""
    bench.ask(unit=2)
    bench.pass_time(0.25)
    bench.client.answers.clear()
    bench.ask()
    bench.hear(damaged(bench))
    assert not is_over(bench)


def test_not_while_the_answer_to_an_earlier_sending_is_late(bench: Bench) -> None:
    """It may be that one, and nobody speaks into the other."""
    bench = Bench(timing=bench.settings.timing, retries=1)
    bench.ask()
    bench.hear("55")
    bench.pass_time(LIMIT + 0.05)
    assert len(bench.written) == 2
    bench.hear(damaged(bench))
    assert not is_over(bench)


@pytest.mark.parametrize("unit", [1, 2])
def test_not_when_another_client_was_heard_before(bench: Bench, unit: int) -> None:
    """It may be the answer to them, from whatever unit: that may be what was damaged."""
    bench.respond(OTHER, unit)
    bench.pass_time(0.02)
    bench.ask()
    bench.hear(damaged(bench))
    assert not is_over(bench)
    bench.pass_time(LIMIT + 0.1)
    assert bench.line.ledger.count_late(bench.now) == 1


def test_not_while_the_request_leaves(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, virtual=False)
    bench.ask()
    bench.hear(damaged(bench))
    assert not is_over(bench)


def test_not_behind_a_copy_that_came_while_the_request_left(bench: Bench) -> None:
    """It may have been another client's."""
    bench = Bench(timing=bench.settings.timing, virtual=False)
    bench.ask()
    bench.pass_time(0.001)
    bench.hear(bench.written[-1])
    bench.pass_time(0.1)
    bench.hear(damaged(bench))
    assert not is_over(bench)


def test_behind_the_echo_it_is(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, echo=True)
    bench.ask()
    bench.hear(bench.written[-1])
    bench.hear(damaged(bench))
    assert is_over(bench)


@pytest.mark.parametrize("unit", [None, 2], ids=["noise", "a response of another unit"])
def test_not_if_anything_came_before_the_echo(bench: Bench, unit: int | None) -> None:
    bench = Bench(timing=bench.settings.timing, echo=True)
    bench.ask()
    bench.hear("55" if unit is None else bench.frame(unit, RESPONSE))
    bench.hear(bench.written[-1])
    bench.hear(damaged(bench))
    assert not is_over(bench)


def test_the_limit_does_not_wait_for_the_silence(bench: Bench) -> None:
    """And an answer of which that is not sure is still owed."""
    bench.ask()
    bench.pass_time(bench.line.deadline() - bench.now - 1e-4)
    bench.hear(damaged(bench))
    bench.pass_time(2e-4)
    assert bench.client.answers == ["83 0B"]
    assert bench.line.ledger.count_late(bench.now) == 1


def test_a_character_with_a_wrong_parity_bit_spoils_the_answer(bench: Bench) -> None:
    """Also where the check sum fits; then it is known as quickly that this was the answer."""
    bench.ask()
    bench.pass_time(REQUEST_TIME + 0.001)
    frame = bytes.fromhex(bench.frame(1, RESPONSE))
    bench.line.received(frame[:-3], bench.now)
    bench.line.received(frame[-3:-2], bench.now, damaged=True)
    bench.line.received(frame[-2:], bench.now)
    bench.pass_time(silence(bench) + 1e-6)
    assert bench.client.answers == ["83 0B"]
    bench.ask(OTHER)
    assert len(bench.written) == 2


def test_a_late_answer_with_a_wrong_parity_bit_is_awaited_still(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(LIMIT + 0.1)
    assert bench.line.ledger.count_late(bench.now) == 1
    bench.line.received(bytes.fromhex(bench.frame(1, RESPONSE)), bench.now, damaged=True)
    assert bench.line.ledger.count_late(bench.now) == 1
    bench.hear(bench.frame(1, RESPONSE))
    assert bench.line.ledger.count_late(bench.now) == 0


def test_a_damaged_echo_costs_no_answer(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, echo=True)
    bench.ask()
    bench.line.received(bytes.fromhex(bench.written[-1]), bench.now, damaged=True)
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def respond_with_wrong_parity(bench: Bench, pdu: str) -> None:
    """The last character is right, but for its parity bit."""
    bench.pass_time(0.03)
    frame = bytes.fromhex(bench.frame(1, pdu))
    bench.line.received(frame[:-1], bench.now)
    bench.line.received(frame[-1:], bench.now, damaged=True)
    bench.pass_time(silence(bench) + 1e-6)


@pytest.mark.parametrize("pdu", ["06 00 30 00 07", "05 00 30 FF 00"])
def test_the_answer_to_a_write_with_a_wrong_parity_bit_is_no_copy_of_it(pdu: str) -> None:
    bench = Bench(virtual=False)
    for _ in range(2):  # nor does it show that somebody else asks here
        bench.ask(pdu)
        respond_with_wrong_parity(bench, pdu)
    assert bench.client.answers == [f"8{pdu[1]} 0B"] * 2
    assert bench.line.ledger.count_late(bench.now) == 0
    assert not bench.line.attribution.overheard.copies


def test_coils_with_a_wrong_parity_bit_are_no_request() -> None:
    bench, heard = Bench(virtual=False), list[str]()
    bench.line.share(lambda: True, lambda: heard.append("another client"))
    bench.ask("01 00 00 00 18")
    respond_with_wrong_parity(bench, "01 03 05 00 81")
    assert bench.client.answers == ["81 0B"]
    assert heard == []
    bench.ask("01 00 00 00 18")
    bench.pass_time(0.03)
    bench.respond("01 03 05 00 81")
    assert bench.client.answers[1:] == ["01 03 05 00 81"]
