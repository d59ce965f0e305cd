"""Who goes next of those that wait for a line: turns, urgency, order, shared reads, and nothing left behind."""

import random
from collections import Counter

import pytest

from gateway.devices.device import Device, EveryDevice
from gateway.lines.counts import total
from gateway.lines.queue import YIELDS, WaitingQueue
from gateway.lines.transaction import BroadcastTransaction, Transaction
from gateway.modbus.pdu import parse_request
from gateway.request import Request
from kit.asker import Asker
from kit.line_bench import Bench

READ = "03 00 10 00 01"
OTHER = "03 00 20 00 01"
READS = [
    *("01 00 10 00 01", "02 00 10 00 01", "03 00 10 00 01", "04 00 10 00 01", "07", "0B", "0C", "11"),
    *("14 07 06 00 04 00 01 00 02", "18 04 DE", "2B 0E 01 00", "08 00 02 00 00", "08 00 12 00 00"),
]
WRITE = "06 00 01 00 05"


class Waiting:
    """A queue on a table. Clients are one letter, and transactions go by a name: client, unit, PDU."""

    def __init__(self, size: int = 64, max_wait: float = 2.0, *, coalesce: bool = True) -> None:
        self.queue = WaitingQueue(size, max_wait, coalesce=coalesce)
        self.clients: dict[str, Asker] = {}
        self.devices: dict[int, Device] = {}
        self.everyone = EveryDevice(Bench().line)
        self.requests: dict[str, Request] = {}
        self.now = 0.0

    def put(
        self,
        client: str,
        pdu: str = READ,
        unit: int = 1,
        *,
        urgent: bool = False,
        yields: bool = False,
        priority: bool = False,
    ) -> Transaction:
        """Let a request wait; its transaction, whether or not it is that one which will be sent.

        It may be for an `urgent` device, or of a client with `priority`.
        """
        transaction = self.transaction(client, pdu, unit, urgent=urgent)
        if priority:
            request = transaction.requests[0]
            request.caller = request.caller.with_priority()
        transaction.yields = yields
        assert self.queue.put(transaction, self.now) is None
        return transaction

    def refused_for(self, client: str, pdu: str = READ, unit: int = 1) -> str:
        """Let a request wait; what is refused for it, which may be this one."""
        refused = self.queue.put(self.transaction(client, pdu, unit), self.now)
        return name(refused) if refused is not None else ""

    def transaction(self, client: str, pdu: str = READ, unit: int = 1, *, urgent: bool = False) -> Transaction:
        origin = self.clients.setdefault(client, Asker(client, host=client[:1]))
        request = origin.ask(pdu, unit=unit, now=self.now)
        asked = parse_request(request.pdu)
        if not unit:
            return BroadcastTransaction(request, asked, self.everyone)
        if unit not in self.devices:
            self.devices[unit] = Bench().device(unit, urgent=urgent)
        return Transaction(request, asked, self.devices[unit])

    def take(self, *held: int) -> str:
        """Who goes next when these units are held: its clients and its unit; "" for none."""
        taken = self.queue.take(lambda waiting: waiting.device.unit in held)
        return name(taken) if taken is not None else ""

    @property
    def coalesced(self) -> int:
        """How many requests have joined another one."""
        return total(counts for device in self.devices.values() for counts in device.counts.values()).coalesced

    def take_all(self, *held: int) -> list[str]:
        """Who goes, in turn, until nobody is left that may."""
        return list(iter(lambda: self.take(*held), ""))

    def is_empty(self) -> bool:
        """Whether nothing is left behind."""
        queue = self.queue
        rows = [row for row in queue._rows() if row.waiting]
        left = (len(queue), queue.has_expiry, queue._reads, queue._given_up, queue._repeats, rows)
        return not any(left) and queue.next_expiry() is None


def name(transaction: Transaction) -> str:
    clients = "+".join(request.caller.client for request in transaction.requests)
    write = "" if transaction.asked.function == 3 else "!"
    return f"{clients}{transaction.device.unit}{write}"


@pytest.fixture
def waiting() -> Waiting:
    return Waiting()


# --- turns ---


def test_an_empty_queue_has_nobody(waiting: Waiting) -> None:
    assert waiting.queue.take() is None
    assert waiting.is_empty()


def test_one_client_is_served_in_the_order_it_asked() -> None:
    waiting = Waiting(coalesce=False)
    for unit in (1, 2, 1, 3):
        waiting.put("A", unit=unit)
    assert waiting.take_all() == ["A1", "A2", "A1", "A3"]


def test_clients_take_turns_whatever_they_have_queued(waiting: Waiting) -> None:
    for unit in (1, 2, 3, 4):
        waiting.put("A", unit=unit)
    for unit in (5, 6):
        waiting.put("B", unit=unit)
    waiting.put("C", unit=7)
    assert waiting.take_all() == ["A1", "B5", "C7", "A2", "B6", "A3", "A4"]


def test_addresses_take_turns_and_the_connections_of_each_take_turns_in_its_turns() -> None:
    waiting = Waiting(coalesce=False)
    for unit in (1, 2):
        for client in ("A1", "A2", "A3"):
            waiting.put(client, unit=unit)
    for unit in (4, 5, 6, 7):
        waiting.put("B1", unit=unit)
    assert waiting.take_all() == ["A11", "B14", "A21", "B15", "A31", "B16", "A12", "B17", "A22", "A32"]
    assert waiting.is_empty()


def test_a_host_has_no_more_turns_for_31_connections_than_another_for_one() -> None:
    waiting = Waiting()
    for number in range(31):
        waiting.put(f"A{number}", f"03 00 {number:02X} 00 01")
    for number in range(4):
        waiting.put("B", unit=2 + number)
    went = waiting.take_all()
    assert [each[0] for each in went[:8]] == ["A", "B"] * 4


def test_who_comes_back_goes_behind_those_who_wait(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    waiting.put("B", unit=2)
    assert waiting.take() == "A1"
    waiting.put("A", unit=3)
    waiting.put("C", unit=4)
    assert waiting.take_all() == ["B2", "A3", "C4"]


def test_a_request_that_expires_does_not_cost_its_client_the_turn() -> None:
    waiting = Waiting(max_wait=1.0)
    waiting.put("A", unit=1)
    waiting.now = 0.5
    waiting.put("A", unit=2)
    waiting.put("B", unit=3)
    waiting.now = 1.0
    assert len(waiting.queue.expired(waiting.now)) == 1
    assert waiting.take_all() == ["A2", "B3"]


def test_who_comes_back_in_the_round_after_its_turn_has_not_lost_its_place(waiting: Waiting) -> None:
    for client in "ABC":
        waiting.put(client, unit=ord(client))
    assert waiting.take() == "A65"
    waiting.put("D", unit=4)
    waiting.put("A", unit=1)
    assert waiting.take_all() == ["B66", "C67", "A1", "D4"]


# --- urgency ---


def test_a_write_goes_before_reads_of_other_clients(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", unit=3)
    waiting.put("C", WRITE, unit=2)
    assert waiting.take_all() == ["C2!", "A1", "B3"]


def test_of_those_who_come_in_a_round_one_goes_before_the_others(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", WRITE, unit=2)
    waiting.put("C", "41 01", unit=3)
    waiting.put("A", unit=4)
    assert waiting.take_all() == ["B2!", "A1", "C3!", "A4"]


@pytest.mark.parametrize("host", ["A", "B"])
def test_programs_that_connect_anew_for_each_write_leave_others_their_turns(host: str) -> None:
    """There is always a connection that has not had its turn yet."""
    waiting = Waiting()
    waiting.put("A0")
    for number in range(1, 3):
        waiting.put(f"{host}{number}", WRITE, unit=2)
    went = []
    for number in range(3, 63):
        went.append(waiting.take())
        if went[-1] == "A01":
            waiting.put("A0")
        else:
            waiting.put(f"{host}{number}", WRITE, unit=2)
    assert went.count("A01") >= len(went) // 4


@pytest.mark.parametrize("pdu", READS)
def test_no_read_goes_before_other_reads(waiting: Waiting, pdu: str) -> None:
    waiting.put("A", unit=2)
    waiting.put("B", pdu)
    assert [waiting.take()[:2], waiting.take()[:2]] == ["A2", "B1"]


def test_a_device_of_high_priority_goes_before_others(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", unit=2, urgent=True)
    assert waiting.take_all() == ["B2", "A1"]


def test_a_clients_own_write_does_not_overtake_its_older_read_of_another_unit(waiting: Waiting) -> None:
    """Priority acts between clients only."""
    waiting.put("A")
    waiting.put("A", WRITE, unit=2)
    waiting.put("B", WRITE, unit=3)
    assert waiting.take_all() == ["B3!", "A1", "A2!"]


def test_who_writes_is_the_first_in_each_round_and_has_one_turn_in_it() -> None:
    waiting = Waiting(coalesce=False)
    for unit in (1, 2, 3):
        waiting.put("A", unit=unit)
        waiting.put("B", unit=unit)
        waiting.put("C", WRITE, unit=4)
    assert waiting.take_all() == ["C4!", "A1", "C4!", "B1", "A2", "C4!", "B2", "A3", "B3"]


def test_so_has_a_connection_among_those_of_its_host() -> None:
    waiting = Waiting(coalesce=False)
    for unit in (1, 2):
        waiting.put("A1", unit=unit)
        waiting.put("A2", WRITE, unit=4)
        waiting.put("B", unit=unit)
    assert waiting.take_all() == ["A24!", "B1", "A11", "A24!", "B2", "A12"]


# --- clients with priority ---


def test_a_client_with_priority_goes_before_others_and_before_what_is_urgent(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", WRITE, unit=2)
    waiting.put("C", unit=3, urgent=True)
    waiting.put("P", unit=4, priority=True)
    assert waiting.take_all() == ["P4", "B2!", "A1", "C3"]


def test_it_has_one_turn_in_each_round_and_its_own_requests_keep_their_order() -> None:
    waiting = Waiting(coalesce=False)
    for unit in (1, 2):
        waiting.put("A", unit=unit)
        waiting.put("B", WRITE, unit=unit)
        waiting.put("P", OTHER, unit=unit, priority=True)
    waiting.put("P", WRITE, unit=2, priority=True)
    assert waiting.take_all() == ["P1", "B1!", "A1", "P2", "B2!", "A2", "P2!"]


def test_who_asks_again_at_once_waits_for_each_of_the_others(waiting: Waiting) -> None:
    for client in "XABC":
        waiting.put(client, unit=ord(client))
    assert waiting.take() == "X88"
    waiting.put("P", unit=4, priority=True)
    for _ in range(3):
        assert waiting.take() == "P4"
        waiting.put("P", unit=4, priority=True)
        for client in "ABC":
            assert waiting.take() == f"{client}{ord(client)}"
            waiting.put(client, unit=ord(client))


def test_who_had_nothing_to_ask_in_its_turn_is_still_first_when_it_asks(waiting: Waiting) -> None:
    waiting.put("P", unit=4, priority=True)
    for client in "ABC":
        waiting.put(client, unit=ord(client))
    assert [waiting.take(), waiting.take()] == ["P4", "A65"]
    for client in "AD":
        waiting.put(client, unit=ord(client))
    assert [waiting.take() for _ in range(3)] == ["B66", "C67", "A65"]
    for client in "BC":
        waiting.put(client, unit=ord(client))
    waiting.put("P", unit=4, priority=True)
    assert waiting.take_all()[0] == "P4"


def test_each_of_several_that_come_in_a_round_goes_first_but_others_have_turns_between_them(waiting: Waiting) -> None:
    for client in "ABC":
        waiting.put(client, unit=ord(client))
    assert waiting.take() == "A65"
    for number, client in enumerate("PQR"):
        waiting.put(client, unit=number, priority=True)
    assert waiting.take_all() == ["P0", "B66", "Q1", "C67", "R2"]


@pytest.mark.parametrize("host", ["A", "B"])
def test_programs_that_connect_anew_for_each_request_leave_others_half_of_the_turns(host: str) -> None:
    """There is always a connection, or with other hosts an address, that has not had its turn yet."""
    waiting = Waiting()
    waiting.put("A0")
    for number in range(1, 3):
        waiting.put(f"{host}{number}", unit=2, priority=True)
    went = []
    for number in range(3, 63):
        went.append(waiting.take())
        if went[-1] == "A01":
            waiting.put("A0")
        else:
            waiting.put(f"{host}{number}", unit=2, priority=True)
    assert went.count("A01") >= len(went) // 2 - 1


def test_endless_newcomers_with_priority_leave_others_half_of_the_turns(waiting: Waiting) -> None:
    waiting.put("A")
    went = []
    for number in range(60):
        waiting.put(chr(0x1000 + number), unit=2, priority=True)
        went.append(waiting.take())
        if went[-1] == "A1":
            waiting.put("A")
    assert went.count("A1") >= len(went) // 2 - 1


def test_priority_is_that_of_the_oldest_request(waiting: Waiting) -> None:
    waiting.put("P", unit=2)
    waiting.put("P", unit=3, priority=True)
    waiting.put("A", WRITE)
    assert waiting.take_all() == ["A1!", "P2", "P3"]


def test_who_has_priority_takes_the_read_that_it_shares_with_it(waiting: Waiting) -> None:
    waiting.put("B", unit=2)
    waiting.put("A")
    waiting.put("P", priority=True)
    assert waiting.take_all() == ["A+P1", "B2"]
    assert waiting.is_empty()


def test_what_is_held_of_a_client_with_priority_lets_others_pass(waiting: Waiting) -> None:
    waiting.put("P", unit=3, priority=True)
    waiting.put("A")
    waiting.put("A", unit=2)
    assert waiting.take(3) == "A1"
    assert waiting.take_all() == ["P3", "A2"]


def test_a_poll_waits_for_a_client_with_priority_like_for_any_other(waiting: Waiting) -> None:
    waiting.put("M", unit=2, yields=True)
    for _ in range(YIELDS + 2):
        waiting.put("P", WRITE, priority=True)
    assert waiting.take_all() == ["P1!"] * YIELDS + ["M2"] + ["P1!"] * 2


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("many", [1, 3])
def test_whoever_waits_has_a_turn_between_two_of_a_client_with_priority(many: int, seed: int) -> None:
    """Clients that ask at random; who has waited for none of them goes next, or after one other."""
    dice = random.Random(seed)
    waiting = Waiting(coalesce=False)
    open_of = dict.fromkeys("ABCDEF" + "PQR"[:many], 0)
    #: For each client with priority, who has waited since its last turn; how many went while it was due.
    before: dict[str, set[str]] = {client: set() for client in "PQR"[:many]}
    passed_by: Counter[str] = Counter()
    for _ in range(1000):
        client = dice.choice([*open_of])
        if open_of[client] < 2 and dice.random() < 0.6:
            pdu = READ if client in before else dice.choice([READ, WRITE])
            waiting.put(client, pdu, unit=ord(client), priority=client in before)
            open_of[client] += 1
        if dice.random() < 0.5 and any(open_of.values()):
            due = {each for each, others in before.items() if open_of[each] and not others}
            waits = {each for each, number in open_of.items() if number}
            went = waiting.take()[:1]
            open_of[went] -= 1
            assert not before.get(went), f"{went} goes again before {before[went]}"
            for others in before.values():
                others.discard(went)
            if went in before:
                before[went] = waits - {went}
            passed_by = Counter({each: passed_by[each] + 1 for each in due - {went}})
            assert max(passed_by.values(), default=0) < 2 * many


# --- polls ---


def test_a_poll_lets_every_client_go_first() -> None:
    waiting = Waiting(coalesce=False)
    waiting.put("M", unit=2, yields=True)
    waiting.put("A")
    waiting.put("A", WRITE)
    waiting.put("B", WRITE)
    assert waiting.take_all() == ["B1!", "A1", "A1!", "M2"]


def test_a_poll_waits_for_so_many_others_and_no_more(waiting: Waiting) -> None:
    waiting.put("M", unit=2, yields=True)
    for _ in range(YIELDS + 2):
        waiting.put("A", WRITE)
    assert waiting.take_all() == ["A1!"] * YIELDS + ["M2"] + ["A1!"] * 2


def test_what_went_while_no_poll_waited_does_not_count(waiting: Waiting) -> None:
    for _ in range(YIELDS):
        waiting.put("A", WRITE)
    assert waiting.take_all() == ["A1!"] * YIELDS
    waiting.put("M", unit=2, yields=True)
    waiting.put("A")
    assert waiting.take_all() == ["A1", "M2"]


def test_nobody_joins_a_poll_but_a_poll_joins_others(waiting: Waiting) -> None:
    waiting.put("M", yields=True)
    waiting.put("A")
    waiting.put("N", yields=True)
    assert waiting.take_all() == ["A+N1", "M1"]


def test_a_plain_request_that_is_held_does_not_stop_the_urgent_ones(waiting: Waiting) -> None:
    waiting.put("A")
    for _ in range(6):
        waiting.put("B", WRITE, unit=3)
    assert waiting.take_all(1) == ["B3!"] * 6
    assert waiting.take_all() == ["A1"]


def test_who_is_held_keeps_its_turn(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    for unit in (2, 3):
        waiting.put("B", unit=unit)
        waiting.put("C", WRITE, unit=unit)
    assert [waiting.take(1) for _ in range(3)] == ["C2!", "C3!", "B2"]
    assert waiting.take_all() == ["A1", "B3"]


# --- order of one client's requests ---


def test_what_is_held_lets_other_units_pass_but_not_its_own(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("A", WRITE)
    waiting.put("A", unit=2)
    held = waiting.queue.take(lambda transaction: transaction.asked.function == 3 and transaction.device.unit == 1)
    assert held is not None
    assert name(held) == "A2"
    assert waiting.take_all() == ["A1", "A1!"]


def test_all_rows_held_is_nobody_and_costs_no_turn(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    waiting.put("B", unit=2)
    assert waiting.take(1, 2) == ""
    assert waiting.take_all() == ["A1", "B2"]


def test_a_held_client_lets_other_clients_pass_to_the_same_unit() -> None:
    waiting = Waiting(coalesce=False)
    waiting.put("A")
    waiting.put("B", OTHER)
    taken = waiting.queue.take(lambda transaction: transaction.client == "A")
    assert taken is not None
    assert name(taken) == "B1"


def test_a_broadcast_does_not_overtake_what_its_client_asked_before(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    waiting.put("A", WRITE, unit=0)
    assert waiting.take(1) == ""
    assert waiting.take_all() == ["A1", "A0!"]


def test_nothing_of_its_client_overtakes_a_broadcast(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    waiting.put("A", WRITE, unit=0)
    waiting.put("A", WRITE, unit=2)
    assert waiting.take(1) == ""
    assert waiting.take_all() == ["A1", "A0!", "A2!"]


def test_a_broadcast_parts_nothing_for_other_clients(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    waiting.put("A", WRITE, unit=0)
    waiting.put("B", unit=2)
    assert waiting.take(1) == "B2"


# --- shared reads ---


def test_equal_reads_of_several_clients_share_one_transaction(waiting: Waiting) -> None:
    for client in "ABC":
        waiting.put(client)
    assert len(waiting.queue) == 3
    assert waiting.coalesced == 2
    assert waiting.take_all() == ["A+B+C1"]
    assert waiting.is_empty()


@pytest.mark.parametrize("pdu", READS)
def test_every_function_that_only_reads_is_shared(waiting: Waiting, pdu: str) -> None:
    waiting.put("A", pdu)
    waiting.put("B", pdu)
    assert waiting.coalesced == 1


@pytest.mark.parametrize("pdu", [WRITE, "17 00 01 00 01 00 64 00 01 02 00 00", "08 00 0A 00 00", "2B 0D 01", "41 01"])
def test_no_other_function_is_shared(waiting: Waiting, pdu: str) -> None:
    waiting.put("A", pdu)
    waiting.put("B", pdu)
    assert waiting.coalesced == 0
    assert len(waiting.take_all()) == 2


def test_other_registers_other_units_and_equal_units_of_other_devices_are_not_shared(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", OTHER)
    waiting.put("C", unit=2)
    del waiting.devices[1]
    waiting.put("D")
    assert waiting.coalesced == 0


def test_without_coalesce_nothing_is_shared() -> None:
    waiting = Waiting(coalesce=False)
    waiting.put("A")
    waiting.put("B")
    assert waiting.take_all() == ["A1", "B1"]
    assert waiting.is_empty()


def test_what_leaves_the_queue_withdraws_no_offer_but_its_own(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", WRITE)
    waiting.put("C")
    assert [waiting.take(), waiting.take()] == ["B1!", "A1"]
    waiting.put("D")
    assert waiting.take_all() == ["C+D1"]


def test_what_has_left_the_queue_is_joined_no_more(waiting: Waiting) -> None:
    """So every answer is newer than its question."""
    waiting.put("A")
    assert waiting.take() == "A1"
    waiting.put("B")
    assert waiting.take() == "B1"


@pytest.mark.parametrize(("pdu", "unit"), [(WRITE, 1), (WRITE, 2), (WRITE, 0), ("41 01", 2)])
def test_anything_but_a_read_parts_them(waiting: Waiting, pdu: str, unit: int) -> None:
    waiting.put("A")
    waiting.put("B", pdu, unit)
    waiting.put("C")
    waiting.put("D")
    assert waiting.take_all() == [f"B{unit}!", "A1", "C+D1"]


def test_a_client_does_not_join_past_its_own_older_request_to_the_unit(waiting: Waiting) -> None:
    waiting.put("B", OTHER)
    waiting.put("A")
    waiting.put("B")
    assert waiting.take_all() == ["B1", "A1", "B1"]


def test_a_client_does_not_join_past_its_own_broadcast(waiting: Waiting) -> None:
    waiting.put("B", unit=3)
    waiting.put("B", WRITE, unit=0)
    waiting.put("A")
    waiting.put("B")
    assert waiting.take_all() == ["B3", "B0!", "A1", "B1"]


def test_a_client_may_join_past_its_own_request_to_another_unit(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B", unit=2)
    waiting.put("B")
    assert waiting.take_all() == ["A+B1", "B2"]


def test_what_a_client_asks_after_joining_follows_what_it_joined(waiting: Waiting) -> None:
    waiting.put("A", unit=2)
    waiting.put("A")
    waiting.put("B")
    waiting.put("B", WRITE)
    assert waiting.take_all() == ["A2", "A+B1", "B1!"]


def test_a_broadcast_follows_everything_its_client_has_joined(waiting: Waiting) -> None:
    waiting.put("A", unit=2)
    waiting.put("A", unit=3)
    waiting.put("B", unit=3)
    waiting.put("B", unit=2)
    waiting.put("B", WRITE, unit=0)
    waiting.put("B", unit=4)
    assert waiting.take_all() == ["A+B2", "A+B3", "B0!", "B4"]


def test_a_second_equal_read_of_a_client_is_a_transaction_of_its_own(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B")
    waiting.put("B")
    assert waiting.take_all() == ["A+B1", "B1"]
    assert waiting.is_empty()


def test_a_shared_read_goes_at_whichever_turn_comes_first(waiting: Waiting) -> None:
    for unit in (2, 3, 4):
        waiting.put("A", unit=unit)
    waiting.put("A")
    waiting.put("B")
    assert waiting.take_all() == ["A2", "A+B1", "A3", "A4"]
    assert waiting.is_empty()


def test_who_must_not_overtake_its_own_older_requests_lets_the_others_go(waiting: Waiting) -> None:
    for pdu in ("03 00 01 00 01", "03 00 02 00 01", "03 00 03 00 01", READ):
        waiting.put("A", pdu)
    waiting.put("B")
    waiting.put("C")
    assert waiting.coalesced == 2
    assert waiting.take_all() == ["A1", "B+C1", "A1", "A1", "A1"]
    assert waiting.coalesced == 1
    assert waiting.is_empty()


def test_so_does_one_of_two(waiting: Waiting) -> None:
    for pdu in ("03 00 01 00 01", "03 00 02 00 01", READ):
        waiting.put("A", pdu)
    waiting.put("B")
    assert waiting.take_all() == ["A1", "B1", "A1", "A1"]


def test_while_the_clients_turn_is_held_another_one_may_go_with_what_is_shared(waiting: Waiting) -> None:
    waiting.put("A", OTHER, unit=2)
    waiting.put("A")
    waiting.put("B")
    assert waiting.queue.take(lambda transaction: transaction.device.unit == 2).device.unit == 1
    assert waiting.take_all() == ["A2"]


def test_who_is_parted_from_a_repeat_has_been_sent_as_often(waiting: Waiting) -> None:
    """Otherwise it is sent once too often, or gets 06 for what was sent."""
    for client, pdu in (("A", READ), ("B", READ), ("A", OTHER)):
        waiting.put(client, pdu)
    for sent in (waiting.queue.take(), waiting.queue.take()):
        sent.gives_up_at = 10.0
        waiting.queue.put_back(sent.again())
    part = waiting.queue.take(lambda transaction: transaction.asked.data == bytes.fromhex(OTHER))
    assert (name(part), part.retries, part.gives_up_at) == ("B1", 1, 10.0)
    assert [transaction.retries for transaction in waiting.queue.clear()] == [1, 1]


# --- expiry, departure, room ---


def test_a_request_that_has_waited_too_long_is_handed_back_and_not_sent() -> None:
    waiting = Waiting(max_wait=1.0)
    late = waiting.put("A")
    waiting.now = 0.5
    waiting.put("B", unit=2)
    assert waiting.queue.next_expiry() == 1.0
    assert waiting.queue.expired(0.999) == ()
    assert [request for request, _ in waiting.queue.expired(1.0)] == late.requests
    assert waiting.take_all() == ["B2"]
    assert waiting.is_empty()


def test_one_of_several_who_share_expires_alone() -> None:
    waiting = Waiting(max_wait=1.0)
    first = waiting.put("A").requests[0]
    waiting.now = 0.5
    waiting.put("B")
    assert [request for request, _ in waiting.queue.expired(1.0)] == [first]
    assert len(waiting.queue) == 1
    assert waiting.take_all() == ["B1"]
    assert waiting.is_empty()


def test_one_who_has_joined_departs_and_the_others_stay() -> None:
    waiting = Waiting(size=2)
    waiting.put("A")
    waiting.put("B")
    waiting.clients["B"].gone = True
    waiting.put("C", unit=2)
    assert waiting.clients["B"].answers == ["83 06"]
    assert waiting.take_all() == ["A1", "C2"]
    assert waiting.is_empty()


def test_who_has_left_what_it_joined_may_join_again() -> None:
    waiting = Waiting(max_wait=1.0)
    waiting.put("A", unit=2)
    waiting.put("B", unit=2)
    waiting.now = 0.5
    waiting.put("C", unit=3)
    waiting.now = 1.0
    assert len(waiting.queue.expired(1.0)) == 2
    waiting.put("B", unit=3)
    assert waiting.take_all() == ["C+B3"]


def test_the_size_counts_requests_shared_ones_too() -> None:
    waiting = Waiting(size=2)
    waiting.put("A")
    waiting.put("B")
    one_more = waiting.transaction("C")
    assert waiting.queue.put(one_more, 0.0) is one_more
    assert waiting.take() == "A+B1"
    waiting.put("C")


def test_departed_clients_make_room_and_their_requests_are_refused() -> None:
    waiting = Waiting(size=2)
    waiting.put("A", WRITE)
    waiting.put("B", unit=2)
    waiting.clients["A"].gone = True
    waiting.put("C", unit=3)
    assert waiting.clients["A"].answers == ["86 06"]
    assert waiting.take_all() == ["B2", "C3"]


# --- who is refused when it is full ---


def test_who_has_most_waiting_gives_up_its_newest_request() -> None:
    waiting = Waiting(size=5)
    for unit in (1, 2, 3):
        waiting.put("A", unit=unit)
    for unit in (4, 5):
        waiting.put("B", unit=unit)
    assert waiting.refused_for("C", unit=6) == "A3"
    assert waiting.take_all() == ["A1", "B4", "C6", "A2", "B5"]
    assert waiting.is_empty()


def test_who_would_have_most_waiting_is_refused_itself() -> None:
    waiting = Waiting(size=4)
    for unit in (1, 2):
        waiting.put("A", unit=unit)
        waiting.put("B", unit=10 + unit)
    assert waiting.refused_for("A", unit=3) == "A3"
    assert waiting.take_all() == ["A1", "B11", "A2", "B12"]


def test_among_equals_nobody_who_waits_is_refused() -> None:
    waiting = Waiting(size=2)
    waiting.put("A", unit=1)
    waiting.put("B", unit=2)
    assert waiting.refused_for("C", unit=3) == "C3"


def test_of_connections_with_equally_much_the_address_with_most_gives_up() -> None:
    waiting = Waiting(size=4)
    for client in ("B1", "A1", "A2", "A3"):
        waiting.put(client, unit=int(client[1:]))
    assert waiting.refused_for("C1", unit=4) == "A11"
    assert waiting.refused_for("A4", unit=5) == "A45"
    assert waiting.take_all() == ["B11", "A22", "C14", "A33"]


def test_what_counts_as_one_address_does_here_too() -> None:
    """Of IPv6, the network of one customer."""
    waiting = Waiting(size=4)
    for number, client in enumerate(("B1", "A1", "A2", "A3")):
        waiting.clients[client] = Asker(client, host=f"2001:db8::{number}", share_key=client[0])
        waiting.put(client, unit=number + 1)
    assert waiting.refused_for("C1", unit=9) == "A12"


def test_a_connection_with_much_gives_up_before_an_address_with_many_connections() -> None:
    waiting = Waiting(size=5)
    for client in ("A1", "A2", "A3"):
        waiting.put(client, unit=1)
    for unit in (2, 3):
        waiting.put("B1", unit=unit)
    assert waiting.refused_for("C1", unit=4) == "B13"


def test_of_a_shared_read_only_the_request_of_who_has_most_is_given_up() -> None:
    waiting = Waiting(size=3)
    waiting.put("A", unit=2)
    waiting.put("B", unit=1)
    waiting.put("A", unit=1)
    assert waiting.refused_for("C", unit=3) == "A1"
    assert waiting.take_all() == ["A2", "B1", "C3"]
    assert waiting.is_empty()


def test_what_was_sent_and_waits_to_be_sent_again_is_not_given_up() -> None:
    waiting = Waiting(size=2)
    waiting.put("A1", unit=1)
    waiting.put("A2", unit=2)
    for _ in range(2):
        again = waiting.queue.take()
        again.retries, again.gives_up_at = 1, 10.0
        waiting.queue.put_back(again)
    assert waiting.refused_for("C", unit=3) == "C3"


def test_what_was_given_up_leaves_nothing_behind() -> None:
    waiting = Waiting(size=2, max_wait=1000.0)
    waiting.put("A", unit=1)
    waiting.put("A", unit=2)
    for number in range(500):
        waiting.refused_for(f"C{number}", unit=3)
        waiting.clients[f"C{number}"].gone = True
    assert len(list(waiting.queue._expiries)) == 2
    assert len(list(waiting.queue._rows())) <= 3


def test_what_is_to_be_dropped_is_and_the_rest_keeps_its_turn(waiting: Waiting) -> None:
    waiting.put("A", unit=1)
    waiting.put("A", unit=2)
    waiting.put("B", unit=3)
    waiting.put("C", unit=1)
    dropped = waiting.queue.drop(lambda transaction: transaction.device.unit == 1)
    assert [name(transaction) for transaction in dropped] == ["A+C1"]
    assert waiting.take_all() == ["A2", "B3"]


def test_clear_drops_everything(waiting: Waiting) -> None:
    waiting.put("A")
    waiting.put("B")
    waiting.put("B", WRITE)
    assert [name(transaction) for transaction in waiting.queue.clear()] == ["A+B1", "B1!"]
    assert waiting.is_empty()


def test_a_dropped_write_makes_its_clients_next_read_plain_again(waiting: Waiting) -> None:
    waiting.put("A", WRITE)
    waiting.put("B", WRITE, unit=3)
    waiting.put("A", unit=2)
    waiting.queue.drop(lambda transaction: transaction.client == "A" and transaction.asked.function == 6)
    assert waiting.take_all() == ["B3!", "A2"]


@pytest.mark.parametrize("host", ["", "A"])
def test_nothing_is_kept_of_clients_that_came_once(waiting: Waiting, host: str) -> None:
    for number in range(100):
        waiting.clients[f"{number}"] = Asker(f"{number}", host=host or f"{number}")
        waiting.put(f"{number}", OTHER)
        waiting.take()
    assert len(list(waiting.queue._rows())) <= 2
    assert waiting.is_empty()
