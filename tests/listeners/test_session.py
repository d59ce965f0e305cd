"""One client's connection: every request gets exactly one response, and all of it is bounded."""

import pytest

from gateway.listeners.session import Session
from gateway.modbus.mbap import encode
from gateway.request import Request

READ = bytes.fromhex("03 00 10 00 01")
RESPONSE = bytes.fromhex("03 02 01 10")


class Target:
    """A Target that keeps its requests, or answers at once."""

    def __init__(self) -> None:
        self.at_once = False
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)
        if self.at_once:
            request.respond(RESPONSE)


class Connection:
    """What the session does to its connection, as one list."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.log: list[str] = []

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        self.log.append("send")

    def pause(self) -> None:
        self.log.append("pause")

    def resume(self) -> None:
        self.log.append("resume")

    def close(self) -> None:
        self.log.append("close")

    def reject(self, reason: str) -> None:
        self.log.append("reject: " + reason)


class Client:
    """A session with a client in the test's hands; at most three requests under way."""

    def __init__(self) -> None:
        self.target = Target()
        self.connection = Connection()
        self.session = Session(
            "10.0.0.9:49152", may_write=True, router=self.target, connection=self.connection, in_flight=3, now=0.0
        )

    def send(self, data: bytes, now: float = 1.0) -> None:
        while data:
            room = self.session.room()
            part, data = data[: len(room)], data[len(room) :]
            room[: len(part)] = part
            self.session.received(len(part), now)

    def ask(self, *transactions: int, unit: int = 7) -> None:
        self.send(b"".join(encode(each, unit, READ) for each in transactions))


@pytest.fixture
def client() -> Client:
    return Client()


def test_a_response_carries_the_requests_own_transaction_and_unit(client: Client) -> None:
    client.ask(0x1234)
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.sent == [encode(0x1234, 7, RESPONSE)]


def test_responses_go_out_in_the_order_they_come(client: Client) -> None:
    client.ask(1, 2)
    client.target.requests[1].respond(RESPONSE)
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.sent == [encode(2, 7, RESPONSE), encode(1, 7, RESPONSE)]


@pytest.mark.parametrize("cut", range(1, 24))
def test_two_requests_cut_anywhere_get_two_responses(client: Client, cut: int) -> None:
    client.target.at_once = True
    data = encode(1, 7, READ) + encode(2, 7, READ)
    client.send(data[:cut])
    client.send(data[cut:])
    assert b"".join(client.connection.sent) == encode(1, 7, RESPONSE) + encode(2, 7, RESPONSE)


def test_what_is_answered_at_once_leaves_in_one_piece(client: Client) -> None:
    client.target.at_once = True
    client.ask(*range(16))
    assert client.connection.sent == [b"".join(encode(each, 7, RESPONSE) for each in range(16))]


def test_beyond_the_bound_nothing_is_read_until_a_response_has_gone(client: Client) -> None:
    client.ask(1, 2, 3, 4)
    assert len(client.target.requests) == 3
    assert client.connection.log == ["pause"]
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.log == ["pause", "send", "resume"]
    client.session.proceed(2.0)
    assert [request.transaction for request in client.target.requests] == [1, 2, 3, 4]
    assert client.target.requests[3].received_at == 2.0


def test_a_broadcast_frees_its_place_without_a_response(client: Client) -> None:
    client.ask(1, 2, 3)
    client.target.requests[0].end()
    assert client.connection.log == ["pause", "resume"]
    assert client.connection.sent == []


def test_a_client_that_takes_no_responses_is_read_no_more(client: Client) -> None:
    client.session.block()
    client.ask(1)
    assert client.target.requests == []
    client.session.unblock()
    client.session.proceed(2.0)
    assert len(client.target.requests) == 1
    assert client.connection.log == ["pause", "resume"]


def test_what_is_no_modbus_is_rejected_after_the_good_responses_have_left(client: Client) -> None:
    client.target.at_once = True
    client.send(encode(1, 7, READ) + b"GET / HTTP/1.0\r\n")
    assert client.connection.sent == [encode(1, 7, RESPONSE)]
    assert client.connection.log[0] == "send"
    assert client.connection.log[1].startswith("reject: an MBAP length of ")
    assert client.session.gone


def test_an_adu_of_another_protocol_is_passed_over(client: Client) -> None:
    foreign = bytearray(encode(1, 7, READ))
    foreign[3] = 1
    client.send(bytes(foreign) + encode(2, 7, READ))
    assert [request.transaction for request in client.target.requests] == [2]


def test_a_client_that_leaves_is_marked_and_hears_nothing(client: Client) -> None:
    client.ask(1)
    client.session.closed()
    assert not client.session.wants(client.target.requests[0])
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.sent == []


def test_a_half_closed_client_gets_its_responses_first(client: Client) -> None:
    client.ask(1)
    client.session.end_of_input()
    assert client.connection.log == []
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.log == ["send", "close"]


def test_of_a_half_closed_client_reads_are_still_sent_and_writes_are_not(client: Client) -> None:
    client.ask(1)
    client.send(encode(2, 7, bytes.fromhex("06 00 01 00 05")))
    read, write = client.target.requests
    assert client.session.wants(read)
    assert client.session.wants(write)
    client.session.end_of_input()
    assert client.session.wants(read)
    assert not client.session.wants(write)


def test_a_half_closed_client_without_requests_is_closed(client: Client) -> None:
    client.session.end_of_input()
    assert client.connection.log == ["close"]


def test_it_is_idle_when_nothing_is_under_way_and_knows_when_it_was_last_asked(client: Client) -> None:
    assert client.session.is_idle
    client.send(encode(1, 7, READ), now=5.0)
    assert not client.session.is_idle
    assert client.session.last_asked == 5.0
    assert repr(client.session) == "<Session 10.0.0.9:49152 in_flight=1>"
