"""One client of Modbus UDP: one response to each request, one execution of each, and all of it bounded."""

from typing import Any

import pytest

from gateway.errors import AccessDenied, IllegalValue, LineDown, QueueFull, RequestError, ResponseTimeout
from gateway.listeners.sessions.peer import Path, Peer
from gateway.listeners.settings import ListenSettings
from gateway.modbus.mbap import TcpFrame, encode
from gateway.request import Caller, Request
from gateway.request import Target as AnyTarget
from kit.waiting import Waiting

READ = bytes.fromhex("03 00 10 00 01")
OTHER_READ = bytes.fromhex("03 00 20 00 01")
WRITE = bytes.fromhex("06 00 10 00 01")
RESPONSE = bytes.fromhex("03 02 01 10")
OTHER_RESPONSE = bytes.fromhex("03 02 02 20")
BUSY = bytes.fromhex("83 06")


class Target(AnyTarget):
    def __init__(self) -> None:
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)


class Client:
    """A peer with a client in the test's hands; at most three requests under way."""

    def __init__(self, **settings: Any) -> None:
        self.target = Target()
        self.sent: list[bytes] = []
        #: Datagrams that have arrived and were not read.
        self.unread: list[TcpFrame] = []
        self.settings = ListenSettings("field", "", 502, in_flight=3, scheme="udp", **settings)
        self.path = Path(self._read, self.sent.append)
        self.peer = Peer(
            Caller("10.0.0.9:49152", "127.0.0.1", "127.0.0.1"),
            router=self.target,
            settings=self.settings,
            path=self.path,
        )

    def ask(self, transaction: int, pdu: bytes = READ, unit: int = 7) -> None:
        self.peer.received(TcpFrame(transaction, unit, pdu), 5.0)

    def _read(self) -> None:
        for adu in self.unread:
            self.peer.notice(adu)

    def respond(self, at: int, pdu: bytes = RESPONSE) -> None:
        self.target.requests[at].respond(pdu)


@pytest.fixture
def client() -> Client:
    return Client()


def test_a_response_carries_the_requests_own_transaction_and_unit(client: Client) -> None:
    client.ask(0x1234)
    assert not client.peer.is_idle
    assert repr(client.peer) == "<Peer 10.0.0.9:49152 in_flight=1>"
    client.respond(0)
    assert client.sent == [encode(0x1234, 7, RESPONSE)]
    assert client.peer.is_idle
    assert client.peer.last_asked == 5.0


def test_who_replaces_a_request_or_is_forgotten_has_given_it_up(client: Client) -> None:
    client.ask(1)
    client.ask(2)
    replaced, other = map(Waiting, client.target.requests)
    client.ask(1, OTHER_READ)
    assert (replaced.is_given_up, other.is_given_up) == (True, False)
    client.peer.closed()
    assert other.is_given_up


def test_requests_are_counted_and_those_without_a_response(client: Client) -> None:
    assert (client.peer.asked, client.peer.in_progress) == (0, 0)
    client.ask(1)
    client.ask(2)
    client.respond(1)
    assert (client.peer.asked, client.peer.in_progress) == (2, 1)


def test_responses_go_out_as_they_come(client: Client) -> None:
    client.ask(1)
    client.ask(2)
    client.respond(1)
    client.respond(0)
    assert client.sent == [encode(2, 7, RESPONSE), encode(1, 7, RESPONSE)]


@pytest.mark.parametrize("pdu", [READ, WRITE])
def test_a_datagram_that_is_repeated_while_its_request_is_under_way_is_executed_once(
    client: Client, pdu: bytes
) -> None:
    for _ in range(5):
        client.ask(1, pdu)
    client.respond(0, pdu)
    assert len(client.target.requests) == 1
    assert client.sent == [encode(1, 7, pdu)]


def test_a_repetition_that_was_noticed_before_the_response_is_not_executed_after_it(client: Client) -> None:
    client.ask(1, WRITE)
    repeated = TcpFrame(1, 7, WRITE)
    assert client.peer.notice(repeated)
    client.respond(0, WRITE)
    client.peer.received(repeated, 5.0, is_repeated=True)
    assert len(client.target.requests) == 1
    assert client.peer.asked == 2


def test_the_same_request_after_its_response_is_another_one(client: Client) -> None:
    client.ask(1)
    client.respond(0)
    client.ask(1)
    client.respond(1)
    assert client.sent == 2 * [encode(1, 7, RESPONSE)]


@pytest.mark.parametrize("other", [{"pdu": WRITE}, {"unit": 8}])
def test_another_request_with_the_same_transaction_takes_the_place_of_the_earlier(client: Client, other: dict) -> None:
    """A client that numbers nothing: the response to what it has given up would be taken for that to the other one."""
    client.ask(1)
    client.ask(1, **other)
    assert [client.peer.wants(request) for request in client.target.requests] == [False, True]
    client.respond(0)
    assert client.sent == []
    client.respond(1)
    assert client.sent == [encode(1, other.get("unit", 7), RESPONSE)]


def test_beyond_the_bound_a_request_is_answered_06(client: Client) -> None:
    for transaction in range(1, 5):
        client.ask(transaction)
    assert client.sent == [encode(4, 7, BUSY)]
    assert len(client.target.requests) == 3
    client.respond(0)
    client.ask(4)
    assert len(client.target.requests) == 4


def test_a_broadcast_ends_without_a_response(client: Client) -> None:
    client.ask(1, WRITE, unit=0)
    client.target.requests[0].end()
    assert client.sent == []
    assert client.peer.is_idle


def test_a_peer_that_is_forgotten_hears_nothing_and_wants_nothing(client: Client) -> None:
    client.ask(1)
    assert client.peer.wants(client.target.requests[0])
    client.peer.closed()
    assert not client.peer.wants(client.target.requests[0])
    client.respond(0)
    assert client.sent == []


# --- on_failure = "silent" ---


@pytest.mark.parametrize("error", [ResponseTimeout(), LineDown(), QueueFull()])
def test_nothing_is_said_of_a_failure_and_its_place_is_free_again(error: RequestError) -> None:
    client = Client(on_failure="silent")
    for transaction in range(3):
        client.ask(transaction)
    client.target.requests[0].fail(error)
    assert client.sent == []
    client.ask(3)
    assert len(client.target.requests) == 4
    client.respond(3)
    assert client.sent == [encode(3, 7, RESPONSE)]


def test_nothing_is_said_to_what_is_beyond_in_flight() -> None:
    client = Client(on_failure="silent")
    for transaction in range(4):
        client.ask(transaction)
    assert client.sent == []
    assert len(client.target.requests) == 3


def test_a_refusal_is_said_and_so_is_an_exception_of_the_unit() -> None:
    client = Client(on_failure="silent")
    client.ask(1)
    client.target.requests[0].fail(AccessDenied())
    client.ask(2)
    client.target.requests[1].fail(IllegalValue())
    client.ask(3)
    client.respond(2, BUSY)
    assert client.sent == [
        encode(1, 7, bytes.fromhex("8301")), encode(2, 7, bytes.fromhex("8303")), encode(3, 7, BUSY),
    ]  # fmt: skip


def test_a_response_for_which_the_next_request_has_arrived_unread_is_dropped(client: Client) -> None:
    client.ask(1)
    client.ask(2)
    client.unread = [TcpFrame(1, 7, OTHER_READ), TcpFrame(2, 7, READ)]
    client.respond(0)
    client.respond(1)
    assert client.sent == [encode(2, 7, RESPONSE)]


def test_a_peer_that_finishes_takes_no_request_but_gives_up_the_one_that_is_replaced(client: Client) -> None:
    client.ask(1)
    client.ask(2)
    client.peer.finish()
    client.ask(1, OTHER_READ)
    client.ask(2)
    client.ask(3)
    assert len(client.target.requests) == 2
    client.respond(0)
    client.respond(1)
    assert client.sent == [encode(2, 7, RESPONSE)]
    assert client.peer.is_idle
