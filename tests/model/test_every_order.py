"""Nothing goes wrong on a line, in whatever order things happen; and a line without one of its rules is found out."""

import random
from dataclasses import replace

import pytest

from gateway.devices.addresses import Whereabouts
from gateway.lines.attribution import Attribution
from gateway.lines.bits import BitsTransaction
from gateway.lines.exchange import Exchange
from gateway.lines.ledger import Ledger
from gateway.lines.line import Line
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.modbus.scan import Expected, Token
from gateway.modbus.scan_rtu import RtuScanner
from model.letters import LETTERS, enabled
from model.long_orders import walk
from model.search import Search, replay, search
from model.settings import ALPHABETS, setting, settings
from model.world import Setting

pytestmark = pytest.mark.search

#: What takes three happenings.
_LONGER = {"copy of answer", "newest answer", "newest foreign answer", "other half"}
FEW = [each for each in ALPHABETS if each != "everything"]


@pytest.mark.parametrize("each", list(settings("everything")), ids=lambda each: each.name)
def test_of_any_two_happenings(each: Setting) -> None:
    found = search(each, 2)
    assert not found.wrong, found
    assert found.states > 300


@pytest.mark.parametrize("alphabet", FEW)
@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_of_three_that_belong_together(mode: str, alphabet: str) -> None:
    port = "real that echoes" if alphabet == "echo" else "direct"
    found = search(setting(mode, port, retries=1, alphabet=alphabet), 3)
    assert not found.wrong, found


def test_of_long_orders() -> None:
    dice, lines = random.Random(1), list(settings(*ALPHABETS))
    for _ in range(3000):
        found = walk(dice.choice(lines), dice)
        assert not found.wrong, found


def test_everything_can_happen() -> None:
    happened = set()
    for port in ("direct", "real that echoes"):
        each = setting(port=port)
        ways = [()]
        for _ in range(2):
            ways = [(*path, letter) for path in ways for letter in enabled(replay(each, path))]
        happened |= {letter for path in ways for letter in path}
    assert set(LETTERS) - happened == _LONGER


def test_states_that_go_on_alike_are_one() -> None:
    def picture(*path: str) -> int:
        return replay(setting(), path).picture()

    over = "read", "answer", "rest"
    assert picture(*over) == picture(*over, *over)
    assert picture("read", "silence") != picture("read")
    assert picture("read", "same read") != picture("same read", "read")


# --- seeded defects ---


def finds(
    letters: str, depth: int, port: str = "direct", mode: str = "rtu", before: tuple[str, ...] = (), **more: object
) -> Search:
    """What is wrong with a line to which only these things happen, after those `before`."""
    each = setting(mode, port, **more)
    each = replace(each, before=(*each.before, *before))
    found = search(replace(each, letters=tuple(letters.split(", "))), depth)
    assert found.wrong
    return found


LATE = "read, answer, silence, limit"
FOREIGN = "read, answer, other foreign read, foreign answer, silence"
LIE = "that is not the answer to it"


def test_a_late_window_of_zero() -> None:
    found = finds(LATE, 5, late_window=0.0)
    assert found.path == ("read", "read", "limit", "answer")
    assert LIE in found.wrong[0]


@pytest.mark.interpreted
def test_a_window_that_forbids_nothing(monkeypatch) -> None:
    monkeypatch.setattr(Ledger, "forbid_until", lambda windows, transaction, now: None)
    assert LIE in finds(LATE, 5).wrong[0]


@pytest.mark.interpreted
def test_a_move_that_does_not_wait_for_the_late_answers_of_its_unit(monkeypatch) -> None:
    """They come from the new address."""

    def forbids_the_same(late: Exchange, other: Transaction) -> bool:
        return late.asked.function == other.asked.function and late.unit == other.device.unit

    monkeypatch.setattr(Exchange, "forbids", forbids_the_same)
    found = finds("read, answer, newest answer, silence", 4, alphabet="moves")
    assert found.path[0] == "newest answer"
    assert found.path[-1] == "answer"
    assert LIE in found.wrong[0]


@pytest.mark.interpreted
def test_a_read_that_was_sent_twice_to_wake_its_device_and_owes_one_answer(monkeypatch) -> None:
    take = Ledger.take

    def take_one(ledger: Ledger, transaction: Transaction) -> Exchange:
        current = take(ledger, transaction)
        current.owed = 1
        return current

    monkeypatch.setattr(Ledger, "take", take_one)
    found = finds("answer, other read, silence", 4, alphabet="wakes")
    assert found.path[-1] == "answer"
    assert LIE in found.wrong[0]


@pytest.mark.interpreted
def test_an_unanswered_move_that_is_forgotten(monkeypatch) -> None:
    monkeypatch.setattr(Whereabouts, "add", lambda whereabouts, unit, change: None)
    found = finds("answer, answer lost, move, silence, limit", 5, alphabet="moves")
    assert found.wrong[0].endswith("asks where no device is")


@pytest.mark.interpreted
def test_other_clients_that_are_not_listened_to(monkeypatch) -> None:
    monkeypatch.setattr(Attribution, "_doubt_about", lambda attribution, frame, ours: None)
    found = finds(FOREIGN, 3)
    assert found.path[-1] == "foreign answer"
    assert LIE in found.wrong[0]


@pytest.mark.interpreted
def test_a_request_that_is_taken_for_coils(monkeypatch) -> None:
    monkeypatch.setattr(Attribution, "_is_twofold", lambda attribution, token: False)
    letters = "read coils, foreign read, foreign read of coils, silence, limit"
    assert LIE in finds(letters, 3).wrong[0]


@pytest.mark.interpreted
def test_a_line_that_does_not_know_of_the_clients_of_an_earlier_one(monkeypatch) -> None:
    handed_on = Ledger.handed_on

    def without_clients(ledger: Ledger, now: float, patience: float) -> list[Exchange]:
        return [each for each in handed_on(ledger, now, patience) if each.owed]

    monkeypatch.setattr(Ledger, "handed_on", without_clients)
    letters = "read coils, foreign read of coils, other foreign read of coils, foreign answer, reload"
    assert LIE in finds(letters, 5).wrong[0]


@pytest.mark.interpreted
def test_a_client_that_asks_the_same_and_is_not_noticed(monkeypatch) -> None:
    is_request = Attribution._is_request

    def is_other_request(attribution: Attribution, token: Token, *, is_sure: bool) -> bool:
        ours = attribution._ledger.last
        is_copy = ours is not None and ours.is_copy(token.frame)
        return is_request(attribution, token, is_sure=is_sure and not is_copy)

    monkeypatch.setattr(Attribution, "_is_request", is_other_request)
    letters = "read, answer, foreign read, foreign answer, silence, read coils, foreign read of coils"
    assert LIE in finds(letters, 5, before=("read", "answer")).wrong[0]  # 7 without them take 16 s


@pytest.mark.interpreted
def test_answers_of_any_unit(monkeypatch) -> None:
    monkeypatch.setattr(Transaction, "accepts", lambda transaction, frame: transaction.asked.accepts(frame.pdu))
    assert LIE in finds("read, read from other unit, answer, limit", 4, mode="ascii").wrong[0]


@pytest.mark.interpreted
def test_an_echo_that_counts_twice(monkeypatch) -> None:
    """The second copy is another client's request: an answer to that follows the one to ours."""
    is_echo = Attribution._is_echo

    def every_time(attribution: Attribution, *frame: object) -> bool:
        attribution._had_echo = False
        return is_echo(attribution, *frame)

    monkeypatch.setattr(Attribution, "_is_echo", every_time)
    letters = "read", "answer", "foreign read", "foreign answer", "request has left", "silence"
    each, dice = replace(setting(port="real that echoes"), letters=letters), random.Random(3)
    assert any(LIE in found.wrong[0] for _ in range(5000) if (found := walk(each, dice)).wrong)


@pytest.mark.interpreted
def test_an_answer_that_may_stand_before_the_echo(monkeypatch) -> None:
    """The echo of a write is its own confirmation then."""
    expect = RtuScanner.expect

    def at_once(scanner: RtuScanner, expected: Expected, sent: bytes, *, echoes: bool) -> None:
        expect(scanner, expected, sent, echoes=False)

    monkeypatch.setattr(RtuScanner, "expect", at_once)
    assert finds("write, echo, limit", 3, "direct with echo").wrong


@pytest.mark.interpreted
def test_no_silence_before_a_request(monkeypatch) -> None:
    tune = Line._tune

    def tune_without(line: Line, latency: float) -> None:
        tune(line, latency)
        line._gap = 0.0

    monkeypatch.setattr(Line, "_tune", tune_without)
    assert "before the silence is over" in finds(LATE, 3).wrong[0]


@pytest.mark.interpreted
def test_a_write_that_is_repeated(monkeypatch) -> None:
    def may_repeat(line: Line, current: Transaction, at: float) -> bool:
        current.gives_up_at = at + 10.0
        return not current.retries

    monkeypatch.setattr(Line, "_may_repeat", may_repeat)
    assert "a write is sent again" in finds("write", 1).wrong[0]


@pytest.mark.interpreted
def test_something_between_the_read_and_the_write_of_bits(monkeypatch) -> None:
    monkeypatch.setattr(WaitingQueue, "take_following", lambda queue: None)
    assert "something else than the read" in finds("bits, other bits, answer, silence", 5).wrong[0]


@pytest.mark.interpreted
def test_a_write_of_bits_into_the_late_window_of_another_write(monkeypatch) -> None:
    """The exception of the late one is taken for its own."""
    monkeypatch.setattr(BitsTransaction, "resembles", lambda waiting, earlier: earlier.function == 3)
    assert LIE in finds("write, bits, answer, newest answer, exception, silence, limit", 6).wrong[0]


@pytest.mark.interpreted
def test_a_line_that_forgets_to_wake(monkeypatch) -> None:
    deadline = Line.deadline
    monkeypatch.setattr(Line, "deadline", lambda line: deadline(line) if line.is_busy else None)
    assert "has no answer" in finds(LATE, 3).wrong[0]


@pytest.mark.interpreted
def test_an_answer_that_is_given_twice(monkeypatch) -> None:
    respond = Transaction.respond

    def respond_twice(transaction: Transaction, pdu: bytes, now: float) -> None:
        respond(transaction, pdu, now)
        respond(transaction, pdu, now)

    monkeypatch.setattr(Transaction, "respond", respond_twice)
    assert "a second answer" in finds(LATE, 2).wrong[0]
