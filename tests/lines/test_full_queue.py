"""Who is refused at a full queue: promise P18, whatever has happened before, and at the same cost for any size."""

import random
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager

import pytest

from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.modbus.pdu import parse_request
from gateway.request import Request
from kit.asker import Asker
from kit.line_bench import Bench


class Full:
    """A queue, and who waits in it by client and by address."""

    def __init__(self, size: int) -> None:
        self.queue = WaitingQueue(size, 1000.0, coalesce=False)
        self.size = size
        self.by_client: Counter[Asker] = Counter()
        self.by_address: Counter[str] = Counter()
        self._device = Bench().device()

    def ask(self, client: Asker) -> Transaction | None:
        """Let a request wait; what is refused for it, if anything, is accounted for."""
        request = client.ask("03 00 10 00 01")
        lost = self.queue.put(Transaction(request, parse_request(request.pdu), self._device), 0.0)
        self._count(request, 1)
        if lost is not None:
            self._count(lost.requests[0], -1)
        return lost

    def take(self) -> None:
        """The line takes one, perhaps of a client that has left."""
        taken = self.queue.take()
        if taken is not None and taken.is_wanted:
            self._count(taken.requests[0], -1)

    def leave(self, client: Asker) -> None:
        """A client leaves: nobody is refused before its requests are dropped."""
        client.gone = True
        self.by_address[client.caller.share_key] -= self.by_client.pop(client, 0)

    def _count(self, request: Request, more: int) -> None:
        self.by_client[request.origin] += more
        self.by_address[request.caller.share_key] += more


@pytest.mark.parametrize("depth", [1, 2, 6])
@pytest.mark.parametrize("hosts", [3, 20])
def test_who_is_refused_has_most_waiting_by_connection_and_if_all_have_one_by_address(depth: int, hosts: int) -> None:
    dice = random.Random(10 * depth + hosts)
    full = Full(16)
    clients = [Asker(f"{number}", host=f"{number % hosts}") for number in range(40)]
    refused = 0
    for number in range(40, 5000):
        at = dice.randrange(len(clients))
        client = clients[at]
        if dice.random() < 0.2:
            full.take()
        elif dice.random() < 0.02:
            full.leave(client)
            clients[at] = Asker(f"{number}", host=client.caller.share_key)
        elif full.by_client[client] < depth:
            loads, addresses = full.by_client.copy(), full.by_address.copy()
            loads[client] += 1
            addresses[client.caller.share_key] += 1
            lost = full.ask(client)
            if lost is not None:
                refused += 1
                loser = lost.requests[0].origin
                assert sum(loads.values()) == full.size + 1
                assert loads[loser] == max(loads.values())
                assert loads[loser] > 1 or addresses[loser.caller.share_key] == max(addresses.values())
    assert refused > 500


@contextmanager
def counting():
    """Counts the calls of functions, those in C too."""
    calls = Counter()
    sys.setprofile(lambda frame, event, argument: calls.update([event]))
    try:
        yield calls
    finally:
        sys.setprofile(None)


def calls_for(step: Callable[[], object], times: int) -> float:
    """How many functions each step calls."""
    with counting() as calls:
        for _ in range(times):
            step()
    return (calls["call"] + calls["c_call"]) / times


@pytest.mark.parametrize("is_new", [False, True])
def test_a_refusal_costs_the_same_whatever_the_size_of_the_queue(is_new: bool) -> None:
    """Of one who has most, and of others for one who comes and leaves."""

    def cost(size: int) -> float:
        full = Full(size)
        clients = [Asker(f"{number}", host=f"{number % 50}") for number in range(size // 16)]
        for client in clients * 16:
            full.ask(client)
        numbers = iter(range(10**6))

        def refuse() -> None:
            number = next(numbers)
            if is_new:
                newcomer = Asker(f"new {number}", host="new")
                full.ask(newcomer)
                newcomer.gone = True
            full.ask(clients[number % len(clients)])

        calls_for(refuse, 50)
        return calls_for(refuse, 200)

    assert cost(6400) < 1.5 * cost(64)
