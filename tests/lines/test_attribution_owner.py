"""The table of attribution, row by row, with the places and times that decide."""

import pytest

from gateway.devices.quirks import AddressZeroDevice
from gateway.lines.attribution import Attribution
from gateway.lines.exchange import Exchange
from gateway.lines.ledger import Ledger
from gateway.lines.transaction import Transaction
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import parse_request
from gateway.modbus.scan import Token
from kit.line_bench import READ, RESPONSE, Bench

THEIRS = "03 00 30 00 01"
WRITE = "06 00 01 00 05"
OTHER_WRITE = "06 00 01 00 06"
#: Of another client's request, in seconds; and when our request is sent, where, and until when a copy is an echo.
PATIENCE = 2.0
NOW = 100.0
PLACE = 50
ECHO_UNTIL = NOW + 0.5


class Table:
    """An attribution, and the frames that it is shown, each behind the one before."""

    def __init__(self) -> None:
        self.ledger = Ledger(None)
        self.attribution = Attribution(self.ledger, lambda asked, answer_time: PATIENCE)
        self.position = PLACE
        self._bench = Bench()

    def transaction(self, pdu: str = READ, unit: int = 1) -> Transaction:
        device = self._bench.device(unit)
        if unit == 0:
            device = AddressZeroDevice(device.settings, self._bench.line)
        asked = parse_request(bytes.fromhex(pdu))
        return device._transaction(self._bench.client.ask(pdu), asked)

    def begin(self, pdu: str = READ, unit: int = 1, now: float = NOW) -> Exchange:
        self.ledger.current = None
        ours = self.ledger.take(self.transaction(pdu, unit))
        ours.sender.sent_at = now
        self.attribution.begin(ours, self.position, ECHO_UNTIL)
        return ours

    def end(self) -> None:
        self.ledger.last.finish(self.position)

    def owner(self, pdu: str, unit: int = 1, at: float = NOW + 0.1, *, is_damaged: bool = False) -> str:
        frame = Frame(unit, bytes.fromhex(pdu))
        start, self.position = self.position, self.position + len(frame.pdu) + 3
        return self.attribution.owner(Token(start, self.position, at, frame, is_damaged=is_damaged))


@pytest.fixture
def table() -> Table:
    return Table()


def test_the_first_that_fits_is_the_response(table: Table) -> None:
    table.begin()
    assert table.owner(RESPONSE) == "the request"
    assert table.owner(RESPONSE) == "nobody"


def test_what_began_before_the_request_is_not(table: Table) -> None:
    table.begin()
    table.position -= 1
    assert table.owner(RESPONSE) == "nobody"
    assert table.owner(RESPONSE) == "the request"


def test_nor_is_a_damaged_frame_nor_one_that_comes_when_the_request_is_over(table: Table) -> None:
    table.begin()
    assert table.owner(RESPONSE, is_damaged=True) == "nobody"
    table.end()
    assert table.owner(RESPONSE) == "nobody"


def test_what_comes_behind_the_response_does_not_put_it_in_doubt(table: Table) -> None:
    """Whether it comes in the same chunk or later."""
    table.begin()
    assert table.owner(RESPONSE) == "the request"
    assert table.owner(THEIRS) == "another's request"
    assert table.owner(RESPONSE) == "another client"
    assert table.attribution.doubt is None


def test_what_may_be_another_clients_response_is_ambiguous(table: Table) -> None:
    assert table.owner(THEIRS) == "another's request"
    assert table.owner(READ) == "another's request"
    table.begin()
    assert table.owner(RESPONSE) == "another client"
    assert table.attribution.doubt.asked.data == bytes.fromhex(THEIRS)
    assert table.owner(RESPONSE) == "another client"
    assert table.owner(RESPONSE) == "nobody"


def test_a_damaged_frame_answers_no_request_of_another_client(table: Table) -> None:
    assert table.owner(THEIRS) == "another's request"
    assert table.owner(RESPONSE, is_damaged=True) == "nobody"
    assert table.owner(RESPONSE) == "another client"


def test_a_damaged_request_counts(table: Table) -> None:
    assert table.owner(THEIRS, is_damaged=True) == "another's request"
    assert table.owner(RESPONSE) == "another client"


@pytest.mark.parametrize("pdu", ["41 00 01", "03 00 30 00 00", "83 02", RESPONSE])
def test_what_is_neither_is_nobodys(table: Table, pdu: str) -> None:
    assert table.owner(pdu) == "nobody"
    assert table.ledger.foreign() == []


# --- who waits for a response ---


def test_another_client_waits_until_it_has_its_response(table: Table) -> None:
    ours = table.ledger.take(table.transaction())
    assert not table.attribution.may_be_others(ours)
    table.owner(THEIRS, unit=2)
    assert not table.attribution.may_be_others(ours)
    table.owner(THEIRS)
    assert table.attribution.may_be_others(ours)
    table.owner(RESPONSE)
    assert not table.attribution.may_be_others(ours)


def test_whoever_waits_may_have_asked_the_unit_at_address_0(table: Table) -> None:
    ours = table.ledger.take(table.transaction(unit=0))
    assert not table.attribution.may_be_others(ours)
    table.owner(THEIRS, unit=2)
    assert table.attribution.may_be_others(ours)


@pytest.mark.parametrize(("later", "is_kept"), [(0.0, True), (0.001, False)])
def test_a_request_is_kept_as_long_as_its_response_may_come(table: Table, later: float, is_kept: bool) -> None:
    table.owner(THEIRS, at=NOW - PATIENCE - later)
    table.owner(THEIRS, at=NOW - 1.0)
    table.begin()
    assert len(table.ledger.foreign()) == 1 + is_kept


@pytest.mark.parametrize(("later", "owner"), [(0.0, "another client"), (0.001, "the request")])
def test_at_address_0_too_a_request_is_doubted_only_as_long_as_its_response_may_come(
    table: Table, later: float, owner: str
) -> None:
    table.owner(THEIRS, unit=77, at=NOW - PATIENCE - later)
    table.begin(unit=0)
    assert table.owner(RESPONSE, unit=77) == owner


# --- late responses ---


def overdue(table: Table, ends_at: float, since: int = 0, answers_from: int | None = 1) -> Exchange:
    left = Exchange(1, answers_from, parse_request(bytes.fromhex(READ)), 0)
    left.ends_at = ends_at
    table.ledger.take_over([left], PATIENCE)
    table.ledger.late[-1].since = since
    return table.ledger.late[-1]


def test_a_late_response_is_for_the_oldest_request_that_it_fits(table: Table) -> None:
    first, second = overdue(table, NOW + 5.0), overdue(table, NOW + 6.0)
    assert table.owner(RESPONSE) == "a late response"
    assert table.attribution.late is first
    assert table.owner(RESPONSE) == "a late response"
    assert table.attribution.late is second
    assert table.owner(RESPONSE) == "nobody"


def test_a_window_of_an_earlier_line_is_for_the_unit_that_was_asked(table: Table) -> None:
    overdue(table, NOW + 5.0)
    assert table.owner(RESPONSE, unit=2) == "nobody"
    assert table.owner("04 02 01 10") == "nobody"
    assert table.owner(RESPONSE) == "a late response"


def test_or_for_any_unit_if_that_is_not_known(table: Table) -> None:
    overdue(table, NOW + 5.0, answers_from=None)
    assert table.owner("04 02 01 10", unit=2) == "nobody"
    assert table.owner(RESPONSE, unit=2) == "a late response"


def test_a_late_response_began_behind_its_request_and_is_not_damaged(table: Table) -> None:
    overdue(table, NOW + 5.0, since=PLACE + 1)
    assert table.owner(RESPONSE) == "nobody"
    assert table.owner(RESPONSE, is_damaged=True) == "nobody"
    assert table.owner(RESPONSE) == "a late response"


def test_another_client_on_a_line_that_has_sent_nothing_yet(table: Table) -> None:
    """A window of the line before it is still open."""
    overdue(table, NOW + 5.0)
    assert table.owner(THEIRS) == "another's request"
    assert table.owner(RESPONSE) == "another client"
    assert table.ledger.next_end() == NOW + 5.0


def test_a_window_lasts_while_the_other_of_two_responses_may_come(table: Table) -> None:
    table.begin()
    table.end()
    overdue(table, NOW + 1.0)
    assert table.owner(THEIRS, at=NOW + 0.5) == "another's request"
    assert table.owner(RESPONSE, at=NOW + 0.9) == "another client"
    assert table.ledger.next_end() == NOW + 0.5 + PATIENCE


# --- copies of our request ---


@pytest.mark.parametrize(("at", "owner"), [(ECHO_UNTIL - 0.001, "an echo"), (ECHO_UNTIL, "another's request")])
def test_a_copy_that_comes_so_soon_is_an_echo(table: Table, at: float, owner: str) -> None:
    table.begin()
    assert table.owner(READ, at=at) == owner


def test_the_second_copy_is_another_clients_request(table: Table) -> None:
    table.begin()
    assert table.owner(READ) == "an echo"
    assert table.owner(READ) == "another's request"


def test_so_is_one_to_another_unit_and_one_of_another_request(table: Table) -> None:
    table.begin()
    assert table.owner(READ, unit=2) == "another's request"
    assert table.owner(THEIRS) == "another's request"
    assert table.owner(READ) == "an echo"


def test_so_is_one_behind_the_end_of_the_request(table: Table) -> None:
    table.begin()
    table.end()
    assert table.owner(READ) == "another's request"


def test_whoever_is_asked_at_address_0_may_repeat_what_was_sent(table: Table) -> None:
    table.begin(unit=0)
    assert table.owner(READ, unit=77) == "an echo"


@pytest.mark.parametrize(("at", "owner"), [(ECHO_UNTIL - 0.001, "an echo"), (ECHO_UNTIL, "another's request")])
def test_a_second_copy_of_a_writes_response_is_an_echo_if_it_comes_so_soon(table: Table, at: float, owner: str) -> None:
    table.begin(WRITE)
    assert table.owner(WRITE) == "the request"
    assert table.owner(WRITE, at=at) == owner
    assert table.owner(WRITE, unit=2) == "another's request"


def test_another_client_that_writes_what_we_wrote_last_waits_for_its_response(table: Table) -> None:
    table.begin(WRITE)
    assert table.owner(WRITE) == "the request"
    assert table.owner(WRITE, at=ECHO_UNTIL) == "another's request"
    table.begin(WRITE, now=ECHO_UNTIL + 0.1)
    assert table.owner(WRITE, at=ECHO_UNTIL + 0.2) == "another client"
    assert table.owner(WRITE, at=ECHO_UNTIL + 0.3) == "another's request"


def test_the_response_of_another_write_cannot_be_theirs(table: Table) -> None:
    """Only an exception can: it does not tell what it refuses."""
    assert table.owner(WRITE) == "another's request"
    table.begin(OTHER_WRITE)
    assert table.owner(OTHER_WRITE) == "the request"
    assert table.owner(WRITE) == "another client"
    assert table.owner(WRITE) == "another's request"
    table.begin(OTHER_WRITE)
    assert table.owner("86 02") == "another client"


def test_copies_besides_the_response_are_counted_request_by_request(table: Table) -> None:
    counts = []
    for copies in (1, 2, 0, 1, 0):
        table.begin()
        counts.append(table.attribution.echoes_in_a_row)
        for _ in range(copies):
            table.owner(READ)
        table.end()
    table.begin()
    assert [*counts, table.attribution.echoes_in_a_row] == [0, 1, 2, 0, 1, 0]
