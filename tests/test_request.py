import pytest

from gateway.errors import LineDown, QueueFull, ResponseTimeout
from gateway.request import Caller, Origin, Request


class Client(Origin):
    """An origin that keeps what it is answered."""

    gone = False

    def __init__(self) -> None:
        self.caller = Caller("10.2.0.7:49152", "127.0.0.1", "127.0.0.1")
        self.answers: list[tuple[Request, bytes | None]] = []

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answers.append((request, pdu))


@pytest.fixture
def client():
    return Client()


@pytest.fixture
def request_(client):
    return Request(17, bytes.fromhex("03 00 6B 00 03"), client, received_at=1.5, transaction=7)


def test_a_response_goes_to_who_asked(client, request_):
    request_.respond(b"\x03\x02\x00\x01")
    assert client.answers == [(request_, b"\x03\x02\x00\x01")]


@pytest.mark.parametrize(
    ("error", "response"),
    [(QueueFull("full"), "83 06"), (LineDown("no port"), "83 0A"), (ResponseTimeout("silence"), "83 0B")],
)
def test_a_failure_becomes_an_exception_response_with_its_code(client, request_, error, response):
    request_.fail(error)
    assert client.answers == [(request_, bytes.fromhex(response))]


def test_a_broadcast_ends_without_a_response(client, request_):
    request_.end()
    assert client.answers == [(request_, None)]


def test_a_request_knows_when_it_came_and_its_transaction(request_):
    assert (request_.received_at, request_.transaction) == (1.5, 7)


def test_a_request_shows_its_bytes_and_its_client(request_):
    assert repr(request_) == "<Request unit=17 03 00 6B 00 03 from 10.2.0.7:49152>"
