"""Unit 0: a write goes to every target once, and the client hears nothing."""

import pytest

from gateway.errors import LineDown
from gateway.request import Request
from gateway.request import Target as AnyTarget
from gateway.routing.broadcast import Broadcast, Recipient
from kit.asker import Asker

WRITE = "06 00 01 00 05"


class Target(AnyTarget):
    """Keeps what it was given."""

    def __init__(self) -> None:
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)


@pytest.fixture
def targets() -> list[Target]:
    return [Target(), Target()]


def broadcast(*targets: Target) -> Broadcast:
    return Broadcast([Recipient(target) for target in targets])


@pytest.mark.parametrize(
    "pdu", ["05 00 01 FF 00", WRITE, "0F 00 00 00 01 01 01", "10 00 00 00 01 02 00 07", "16 00 01 00 F2 00 25"]
)
def test_each_target_gets_a_write_once_for_unit_0(targets: list[Target], pdu: str) -> None:
    broadcast(*targets).submit(Asker().ask(pdu, unit=0), 0.0)
    assert [[(copy.unit, copy.pdu) for copy in target.requests] for target in targets] == [
        [(0, bytes.fromhex(pdu))]
    ] * 2


def test_it_ends_without_a_response_once_every_target_is_done(targets: list[Target]) -> None:
    client = Asker()
    broadcast(*targets).submit(client.ask(WRITE, unit=0), 0.0)
    targets[0].requests[0].end()
    assert client.answers == []
    targets[1].requests[0].fail(LineDown())
    assert client.answers == [None]


def test_without_targets_it_ends_at_once() -> None:
    client = Asker()
    Broadcast([]).submit(client.ask(WRITE, unit=0), 0.0)
    assert client.answers == [None]


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [("03 00 00 00 01", "83 01"), ("17 00 00 00 01 00 00 00 01 02 00 00", "97 01"), ("05 00 00 12 34", "85 03")],
)
def test_reads_and_malformed_writes_go_nowhere(targets: list[Target], pdu: str, answer: str) -> None:
    client = Asker()
    broadcast(*targets).submit(client.ask(pdu, unit=0), 0.0)
    assert client.answers == [answer]
    assert not targets[0].requests


def test_bits_are_not_written_to_all_devices(targets: list[Target]) -> None:
    """Without function 22 each register would have to be read, and a broadcast has no response."""
    client = Asker()
    request = client.ask("16 00 01 00 F2 00 25", unit=0)
    request.in_one_turn = 6
    broadcast(*targets).submit(request, 0.0)
    assert client.answers == ["96 01"]
    assert not targets[0].requests


def test_the_copies_are_gone_when_the_client_is(targets: list[Target]) -> None:
    client = Asker()
    broadcast(*targets).submit(client.ask(WRITE, unit=0), 0.0)
    client.gone = True
    copy = targets[0].requests[0]
    assert not copy.origin.wants(copy)


def test_who_does_not_know_the_function_gets_no_copy(targets: list[Target]) -> None:
    client = Asker()
    knows_16 = Recipient(targets[0], frozenset({5, 16}))
    Broadcast([knows_16, Recipient(targets[1])]).submit(client.ask(WRITE, unit=0), 0.0)
    assert [len(target.requests) for target in targets] == [0, 1]
    targets[1].requests[0].end()
    assert client.answers == [None]
