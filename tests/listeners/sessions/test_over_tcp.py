"""Clients of RTU and ASCII over TCP: one response at a time, in order, and none that is awaited no more."""

import gc
from collections.abc import Callable
from itertools import combinations

import pytest

from gateway.errors import IllegalValue, QueueFull, ResponseTimeout
from gateway.listeners.sessions.arrivals import LOOK_STEP, SILENCE, TOGETHER
from gateway.listeners.sessions.over_tcp import MOST_BROADCASTS, MOST_NOISE, OverTcpSession
from gateway.listeners.sessions.session import LONGEST_HOLD, SENDING_DEADLINE
from gateway.listeners.sessions.session import Connection as AnyConnection
from gateway.listeners.settings import ListenSettings
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.request import Caller, Request
from gateway.request import Target as AnyTarget
from kit.waiting import Waiting

READ = bytes.fromhex("03 00 10 00 01")
OTHER_READ = bytes.fromhex("03 00 20 00 01")
WRITE = bytes.fromhex("06 00 10 00 01")
UNKNOWN = bytes.fromhex("41 01 02")
RESPONSE = bytes.fromhex("03 02 01 10")
OTHER_RESPONSE = bytes.fromhex("03 02 02 20")
#: What a client waits for a response before it asks again, in seconds.
TIME_OUT = 0.5

ENCODE = {"rtu+tcp": rtu.encode, "ascii+tcp": ascii_framing.encode}


class Target(AnyTarget):
    """A Target that keeps its requests, or answers at once."""

    def __init__(self) -> None:
        self.at_once = False
        self.has_room = True
        self.requests: list[Request] = []

    @property
    def asked(self) -> list[bytes]:
        return [request.pdu for request in self.requests]

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)
        if not self.has_room:
            request.fail(QueueFull())
        elif self.at_once:
            request.respond(RESPONSE if request.pdu == READ else OTHER_RESPONSE)


class Connection(AnyConnection):
    """What the session does to its connection. `wakes_at` is when it wants to be called."""

    def __init__(self) -> None:
        self.sent = b""
        self.log: list[str] = []
        self.wakes_at: float | None = None
        self.held_for: list[float] = []
        self.is_paused = False
        self.unread = b""
        self.now = 100.0

    def time(self) -> float:
        return self.now

    def receive(self, room: memoryview) -> int:
        part, self.unread = self.unread[: len(room)], self.unread[len(room) :]
        room[: len(part)] = part
        return len(part)

    def send(self, data: bytes) -> None:
        self.sent += data

    def pause(self) -> None:
        self.is_paused = True

    def resume(self) -> None:
        self.is_paused = False
        self.wakes_at = 0.0

    def wake(self, when: float | None) -> None:
        self.wakes_at = when

    def release_after(self, seconds: float) -> None:
        self.held_for.append(seconds)

    def close(self) -> None:
        self.log.append("close")

    def reject(self, reason: str) -> None:
        self.log.append("reject: " + reason)


class Client:
    """A session with a client in the test's hands, which has a clock of its own."""

    def __init__(
        self, scheme: str, *, in_flight: int = 16, unit0: str | int = "refuse", on_failure: str = "exception"
    ) -> None:
        self.unsent = b""
        self.encode: Callable[[int, bytes], bytes] = ENCODE[scheme]
        self.target = Target()
        self.connection = Connection()
        self.session = OverTcpSession(
            Caller("10.0.0.9:49152", "127.0.0.1", "127.0.0.1"),
            router=self.target,
            connection=self.connection,
            settings=ListenSettings(
                "field", "::", 502, in_flight=in_flight, unit0=unit0, on_failure=on_failure, scheme=scheme
            ),
            now=self.now,
        )

    @property
    def now(self) -> float:
        return self.connection.now

    @now.setter
    def now(self, now: float) -> None:
        self.connection.now = now

    def send(self, data: bytes) -> None:
        self.unsent += data
        while self.unsent and not self.connection.is_paused and not self.session.gone:
            room = self.session.room()
            part, self.unsent = self.unsent[: len(room)], self.unsent[len(room) :]
            room[: len(part)] = part
            self.session.received(len(part), self.now)
            self._settle()

    def ask(self, *pdus: bytes, unit: int = 7) -> None:
        """Send requests in one piece."""
        self.send(b"".join(self.encode(unit, pdu) for pdu in pdus))

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + seconds
        while self.connection.wakes_at is not None and self.connection.wakes_at <= end:
            self.now = max(self.now, self.connection.wakes_at)
            self._wake()
        self.now = end
        if seconds and not self.session.gone:
            self.session.look(self.now)
            self._settle()

    def stand_still(self, seconds: float) -> None:
        """Let time pass in which the gateway does nothing: what is sent meanwhile has to be put into `unread`."""
        self.now += seconds

    def respond(self, at: int, pdu: bytes = RESPONSE) -> None:
        """Let the target answer one of its requests; then the connection has its turn."""
        self.target.requests[at].respond(pdu)
        self._settle()
        self.send(b"")

    def fail(self, at: int) -> None:
        """The unit of one of the target's requests has not answered."""
        self.target.requests[at].fail(ResponseTimeout())
        self._settle()
        self.send(b"")

    def release(self) -> None:
        """The client was held back for long enough."""
        self.session.release()
        self._settle()
        self.send(b"")

    def heard(self, *pdus: bytes, unit: int = 7) -> bool:
        """Whether exactly these responses have come since the last call."""
        sent, self.connection.sent = self.connection.sent, b""
        return sent == b"".join(self.encode(unit, pdu) for pdu in pdus)

    def _settle(self) -> None:
        while self.connection.wakes_at is not None and self.connection.wakes_at <= self.now:
            self._wake()

    def _wake(self) -> None:
        self.connection.wakes_at = None
        if not self.session.gone:
            self.session.proceed(self.now)


@pytest.fixture(params=ENCODE)
def client(request: pytest.FixtureRequest) -> Client:
    return Client(request.param)


@pytest.fixture
def rtu_client() -> Client:
    return Client("rtu+tcp")


# --- in pieces, in one piece ---


def test_requests_cut_anywhere_get_their_responses_in_order(client: Client) -> None:
    client.target.at_once = True
    data = client.encode(7, READ) + client.encode(7, OTHER_READ)
    for first, second in combinations(range(len(data) + 1), 2):
        for piece in (data[:first], data[first:second], data[second:]):
            client.send(piece)
        assert client.heard(RESPONSE, OTHER_RESPONSE)


def test_requests_that_come_together_wait_for_one_another(client: Client) -> None:
    client.ask(READ, OTHER_READ, WRITE)
    assert client.target.asked == [READ]
    client.wait(3.0)
    client.respond(0)
    assert client.heard(RESPONSE)
    assert client.target.asked == [READ, OTHER_READ]
    assert client.session.wants(client.target.requests[1])
    client.respond(1, OTHER_RESPONSE)
    client.respond(2, WRITE)
    assert client.heard(OTHER_RESPONSE, WRITE)
    assert client.session.is_idle
    assert (client.session.asked, client.session.in_progress) == (3, 0)


@pytest.mark.parametrize("in_flight", [1, 2, 16])
@pytest.mark.parametrize("scheme", ENCODE)
def test_a_thousand_requests_in_one_piece_get_a_thousand_responses(scheme: str, in_flight: int) -> None:
    """However slowly they are answered: beyond `in_flight` nothing is read, and what is not read is not late."""
    client = Client(scheme, in_flight=in_flight)
    pdus = [bytes.fromhex("10 00 00 00 01 02") + number.to_bytes(2) for number in range(1000)]
    client.ask(*pdus)
    for number, pdu in enumerate(pdus):
        assert len(client.target.requests) == number + 1
        client.wait(1.5)
        client.respond(number, pdu)
        assert client.heard(pdu)
    assert client.session.is_idle
    assert not client.connection.is_paused


# --- when a line has no room ---


def test_of_requests_in_one_piece_none_is_taken_behind_one_that_found_no_room(client: Client) -> None:
    client.target.has_room = False
    client.ask(READ, READ, READ)
    for number in range(1, 4):
        client.wait(0.1)
        assert len(client.target.requests) == len(client.connection.held_for) == number
        assert client.heard(bytes.fromhex("83 06"))
        client.release()
    client.target.has_room = client.target.at_once = True
    client.ask(READ)
    assert client.heard(RESPONSE)
    assert not client.connection.is_paused


def test_a_time_out_is_noticed_while_the_client_is_held_back(client: Client) -> None:
    client.target.has_room = False
    client.ask(READ)
    assert client.connection.held_for
    assert client.heard(bytes.fromhex("83 06"))
    client.target.has_room = True
    client.ask(READ)
    assert client.target.asked == [READ]
    client.wait(LONGEST_HOLD * 0.8)
    client.ask(OTHER_READ)
    client.release()
    assert client.target.asked == [READ, OTHER_READ]
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


@pytest.mark.parametrize("scheme", ENCODE)
def test_a_client_that_is_held_back_can_send_so_much_as_others(scheme: str) -> None:
    client = Client(scheme, in_flight=2)
    client.target.has_room = False
    client.ask(*[READ] * 9)
    assert client.connection.is_paused
    assert len(client.target.requests) == 1
    client.target.has_room = client.target.at_once = True
    client.release()
    assert len(client.target.requests) == 9
    assert not client.connection.is_paused


# --- a request that the client has given up ---


def test_a_late_response_is_not_taken_for_the_next_one(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    assert client.target.asked == [READ, OTHER_READ]
    client.respond(0, RESPONSE)
    assert client.heard()
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


def test_a_response_is_late_when_the_next_request_has_arrived_and_nobody_has_read_it(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    client.connection.unread = client.encode(7, OTHER_READ)
    client.respond(0, RESPONSE)
    assert client.heard()
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


@pytest.mark.parametrize("cut", range(1, 8))
@pytest.mark.parametrize("is_unread", [False, True])
def test_a_response_is_late_when_the_next_request_has_begun(client: Client, cut: int, *, is_unread: bool) -> None:
    """It would be taken for the response to that, as soon as the rest has been sent."""
    client.ask(READ)
    client.wait(TIME_OUT)
    whole = client.encode(7, OTHER_READ)
    if is_unread:
        client.connection.unread = whole[:cut]
    else:
        client.send(whole[:cut])
        assert not client.session.wants(client.target.requests[0])
    client.respond(0)
    assert client.heard()
    client.send(whole[cut:])
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


def test_a_response_is_late_when_a_request_with_a_wrong_check_sum_has_come_since(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    broken = bytearray(client.encode(7, OTHER_READ))
    broken[5] ^= 1
    client.send(bytes(broken))
    client.respond(0)
    client.wait(SILENCE)
    assert client.heard()
    assert client.session.is_idle


def test_what_switching_a_line_leaves_behind_a_request_gives_nothing_up(client: Client) -> None:
    """As a client sends it that is itself behind a device server."""
    client.send(client.encode(7, READ) + b"\xff")
    client.wait(TOGETHER)
    client.send(b"\xff")
    client.wait(TIME_OUT)
    client.respond(0)
    assert client.heard(RESPONSE)


def test_answering_hands_nothing_on_and_reads_no_requests_by_itself(client: Client) -> None:
    """The session never acts on what has arrived inside a call of whoever answers: it is on the line's own way."""
    client.ask(READ)
    client.wait(TIME_OUT)
    client.connection.unread = client.encode(7, OTHER_READ)
    client.target.requests[0].respond(RESPONSE)
    assert client.target.asked == [READ]
    assert client.connection.sent == b""
    assert client.connection.wakes_at == 0.0
    assert not client.session.is_idle
    client.wait(0.0)
    assert client.target.asked == [READ, OTHER_READ]


def test_a_response_waits_for_what_has_arrived_and_leaves_when_that_was_sent_together(client: Client) -> None:
    client.ask(READ)
    client.connection.unread = client.encode(7, OTHER_READ)
    client.respond(0)
    assert client.heard(RESPONSE)
    assert client.target.asked == [READ, OTHER_READ]
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


def test_what_arrives_while_a_response_is_kept_is_looked_at_in_order(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    whole = client.encode(7, OTHER_READ)
    client.connection.unread = whole[:3]
    client.target.requests[0].respond(RESPONSE)
    client.send(whole[3:])
    assert client.target.asked == [READ, OTHER_READ]
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


@pytest.mark.parametrize("write", ["10 0000 0003 06 FFFE 0001 0002", "10 0000 0006 0C 0300 0001 0000 0003 00FF 0001"])
def test_a_part_of_a_request_is_not_taken_for_modbus_tcp(write: str) -> None:
    pdu = bytes.fromhex(write)
    whole = ENCODE["rtu+tcp"](1, pdu)
    for begin, end in combinations(range(1, len(whole)), 2):
        client = Client("rtu+tcp")
        for piece in (whole[:begin], whole[begin:end], whole[end:]):
            client.send(piece)
        assert (client.connection.log, client.target.asked) == ([], [pdu])


@pytest.mark.parametrize("scheme", ENCODE)
@pytest.mark.parametrize("address", [0, 5, 600])
def test_a_client_that_sends_modbus_tcp_is_rejected_and_told_what_is_for_it(scheme: str, address: int) -> None:
    client = Client(scheme)
    client.send(mbap.encode(0, 1, b"\x03" + address.to_bytes(2) + b"\0\x0a"))
    own = scheme.partition("+")[0].upper()
    assert client.connection.log == [
        f"reject: what it sends is not {own}: this looks like Modbus TCP, which tcp:// is for"
    ]
    assert client.target.asked == []


def test_a_client_that_has_asked_once_is_not_rejected_for_what_noise_looks_like(client: Client) -> None:
    client.ask(READ)
    client.respond(0)
    client.wait(TIME_OUT)
    client.send(mbap.encode(0, 1, READ))
    assert not any(each.startswith("reject") for each in client.connection.log)


@pytest.mark.parametrize("scheme", ENCODE)
def test_damage_in_the_first_request_is_no_other_framing(scheme: str) -> None:
    client = Client(scheme)
    for pdu in ("03 0000 0001", "03 0000 0002", "03 0000 0006", "06 0000 0006"):
        adu = bytearray(ENCODE[scheme](1, bytes.fromhex(pdu)))
        adu[-3] ^= 1
        client.send(bytes(adu))
        client.wait(TIME_OUT)
    assert not any(each.startswith("reject") for each in client.connection.log)


def test_nothing_is_sent_to_a_client_of_whom_only_noise_has_arrived(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    client.connection.unread = b"\xff" * 2 * MOST_NOISE
    client.respond(0)
    client.send(client.connection.unread)
    assert client.connection.log[0].startswith("reject: ")
    assert client.heard()


def test_a_request_given_up_while_the_client_takes_no_responses_is_not_handed_on(client: Client) -> None:
    client.ask(READ, OTHER_READ)
    client.session.block(client.now)
    client.respond(0)
    client.wait(TIME_OUT)
    client.ask(WRITE)
    client.session.unblock()
    client.wait(0.0)
    assert client.target.asked == [READ, WRITE]
    client.respond(1, WRITE)
    assert client.heard(RESPONSE, WRITE)


def test_what_has_been_given_up_need_not_be_sent_any_more(client: Client) -> None:
    client.ask(WRITE)
    assert client.session.wants(client.target.requests[0])
    waiting = Waiting(client.target.requests[0])
    client.wait(TIME_OUT)
    client.ask(READ)
    assert [client.session.wants(request) for request in client.target.requests] == [False, True]
    assert waiting.is_given_up


@pytest.mark.parametrize("scheme", ENCODE)
def test_a_client_that_never_waits_long_enough_gets_the_last_response_only(scheme: str) -> None:
    """Also when it may have one request under way: the gateway goes on reading, or it would not notice."""
    client = Client(scheme, in_flight=1)
    for _ in range(50):
        client.ask(READ)
        client.wait(TIME_OUT)
    assert not client.connection.is_paused
    for number in range(49):
        client.respond(number, OTHER_RESPONSE)
    assert client.heard()
    client.respond(49)
    assert client.heard(RESPONSE)


def test_those_that_came_together_are_given_up_together(client: Client) -> None:
    client.ask(READ, READ, READ)
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(0)
    assert client.target.asked == [READ, OTHER_READ]
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


def test_a_response_before_the_time_out_gives_nothing_up(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    client.respond(0)
    client.ask(OTHER_READ)
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(RESPONSE, OTHER_RESPONSE)


def test_together_ends_with_a_pause_between_two_requests(client: Client) -> None:
    client.ask(READ)
    client.wait(TOGETHER)
    client.ask(READ)
    assert client.target.asked == [READ]
    client.wait(TOGETHER + 0.001)
    client.ask(OTHER_READ)
    assert client.target.asked == [READ, OTHER_READ]


@pytest.mark.parametrize("scheme", ENCODE)
def test_a_client_that_once_sent_too_much_at_a_time_gives_up_as_others_do(scheme: str) -> None:
    client = Client(scheme, in_flight=1)
    client.ask(READ, READ)
    assert client.connection.is_paused
    client.respond(0)
    assert not client.connection.is_paused
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(1)
    client.respond(2, OTHER_RESPONSE)
    assert client.heard(RESPONSE, OTHER_RESPONSE)


def test_a_request_in_lower_case_digits_is_later_too_though_it_begins_together_with_the_one_before() -> None:
    client = Client("ascii+tcp")
    text = client.encode(7, bytes.fromhex("03 00 AB 00 01")).lower()
    client.send(text + text[:-1])
    client.wait(TIME_OUT)
    client.send(text[-1:])
    client.respond(0)
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


# --- when the gateway stood still ---


def asks_anew(client: Client) -> None:
    """What a client does that has had its time-out."""
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(-1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


@pytest.mark.parametrize("at_once", [False, True])
def test_of_requests_that_were_read_late_together_none_is_answered(client: Client, *, at_once: bool) -> None:
    """They may have been sent together, or the first one may have been given up: either way one answer is wrong."""
    client.target.at_once = at_once
    client.stand_still(TIME_OUT)
    client.ask(READ, OTHER_READ, READ)
    assert client.target.asked == []
    assert client.heard()
    client.target.at_once = False
    asks_anew(client)


def test_a_request_that_was_read_late_alone_is_answered(client: Client) -> None:
    client.stand_still(TIME_OUT)
    client.ask(READ)
    client.respond(0)
    assert client.heard(RESPONSE)
    asks_anew(client)


@pytest.mark.parametrize("is_unread", [False, True])
def test_a_request_soon_after_one_that_was_read_late_may_replace_it(client: Client, *, is_unread: bool) -> None:
    client.stand_still(TIME_OUT)
    client.ask(READ)
    client.wait(TOGETHER / 2)
    if is_unread:
        client.connection.unread = client.encode(7, OTHER_READ)
    else:
        client.ask(OTHER_READ)
    client.respond(0)
    assert client.target.asked == [READ]
    assert client.heard()
    asks_anew(client)


def test_a_request_a_while_after_one_that_was_read_late_replaces_it(client: Client) -> None:
    client.stand_still(TIME_OUT)
    client.ask(READ)
    client.wait(2 * TOGETHER)
    client.ask(OTHER_READ)
    client.respond(0)
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


def test_a_request_that_was_read_late_may_belong_to_the_one_before(client: Client) -> None:
    """To answer only the later one is wrong for a client that has sent both together."""
    client.ask(READ)
    client.stand_still(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(0)
    assert client.target.asked == [READ]
    assert client.heard()
    asks_anew(client)


def test_a_request_that_was_read_late_replaces_one_that_is_older_than_the_stand_still(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    client.stand_still(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(0)
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


def test_a_request_that_was_read_late_is_answered_when_no_response_is_missing(client: Client) -> None:
    client.ask(READ)
    client.respond(0)
    client.stand_still(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(RESPONSE, OTHER_RESPONSE)


def test_a_response_is_late_when_what_was_read_late_may_be_the_next_request(client: Client) -> None:
    whole = client.encode(7, OTHER_READ)
    client.ask(READ)
    client.stand_still(TIME_OUT)
    client.send(whole[:4])
    client.respond(0)
    assert client.heard()
    client.wait(0.001)
    client.send(whole[4:])
    client.respond(-1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)


def test_broadcasts_that_were_read_late_are_handed_on_and_give_nothing_up(client: Client) -> None:
    client.stand_still(TIME_OUT)
    client.send(client.encode(0, WRITE) + client.encode(0, WRITE) + client.encode(7, READ))
    assert client.target.asked[:2] == [WRITE, WRITE]
    for request in client.target.requests[:2]:
        request.end()
    client.wait(0.001)
    client.respond(-1)
    assert client.heard(RESPONSE)


def test_what_was_read_before_a_response_leaves_is_no_fresher_for_a_look(client: Client) -> None:
    """It waits until the loop has time for it, and finds nothing more."""
    client.ask(READ)
    client.stand_still(TIME_OUT)
    client.connection.unread = client.encode(7, OTHER_READ) + client.encode(7, WRITE)
    client.target.requests[0].respond(RESPONSE)
    client.session.look(client.now)
    client.wait(0.0)
    assert client.target.asked == [READ]
    assert client.heard()
    asks_anew(client)


def test_what_arrives_while_the_gateway_stands_still_in_a_look_is_no_fresher_for_it(client: Client) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    receive = client.connection.receive

    def stand_still_and_receive(room: memoryview) -> int:
        client.connection.receive = receive
        client.stand_still(TIME_OUT)
        client.connection.unread = client.encode(7, OTHER_READ) + client.encode(7, WRITE)
        return receive(room)

    client.connection.receive = stand_still_and_receive
    client.wait(LOOK_STEP)
    assert client.target.asked == [READ]
    asks_anew(client)


def test_what_arrives_while_the_gateway_stands_still_behind_a_read_is_no_fresher_for_it(client: Client) -> None:
    """The time is asked for when bytes have been read: others may have arrived before it."""
    whole = client.encode(7, OTHER_READ)
    client.session.room()[:3] = whole[:3]
    client.stand_still(TIME_OUT)
    client.session.received(3, client.now)
    client.send(whole[3:] + client.encode(7, WRITE))
    assert client.target.asked == []
    asks_anew(client)


def test_what_a_look_leaves_unread_is_no_fresher_for_it(client: Client) -> None:
    client.stand_still(TIME_OUT)
    noise = bytes(len(client.session.room()))
    client.connection.unread = noise + client.encode(7, READ) + client.encode(7, OTHER_READ)
    client.session.look(client.now)
    rest, client.connection.unread = client.connection.unread, b""
    client.send(rest)
    client.wait(SILENCE)
    assert client.target.asked == []
    asks_anew(client)


def test_requests_that_were_sent_together_do_not_replace_each_other_because_the_gateway_is_a_little_late(
    client: Client,
) -> None:
    """It reads the second one 53 ms after the first, and does not know that it came 20 ms after it."""
    client.ask(READ)
    client.wait(0.015)
    client.stand_still(0.038)
    client.ask(OTHER_READ)
    client.respond(0)
    assert client.target.asked == [READ]
    assert client.heard()
    asks_anew(client)


@pytest.mark.parametrize("is_unread", [False, True])
@pytest.mark.parametrize("seconds", [SILENCE + 0.01, 1.5])
@pytest.mark.parametrize("cut", [1, 4, 7])
def test_half_a_request_is_not_forgotten_when_the_gateway_stood_still(
    client: Client, cut: int, seconds: float, *, is_unread: bool
) -> None:
    """Its rest has come in time. The response to the next one would be taken for that to this one."""
    client.target.at_once = True
    whole = client.encode(7, READ)
    client.send(client.encode(7, READ) + whole[:cut])
    assert client.heard(RESPONSE)
    rest = whole[cut:] + client.encode(7, OTHER_READ)
    client.stand_still(seconds)
    if is_unread:
        client.connection.unread = rest
        client.wait(0.0)
        client.session.look(client.now)
    else:
        client.send(rest)
    client.wait(SILENCE)
    assert client.heard()
    client.target.at_once = False
    asks_anew(client)


def test_half_a_request_is_continued_after_a_pause_of_the_gateway(client: Client) -> None:
    client.target.has_room = False
    whole = client.encode(7, OTHER_READ)
    client.session.block(client.now)
    client.send(client.encode(7, READ) + whole[:5])
    client.now += 10 * SILENCE
    client.session.unblock()
    client.wait(0.0)
    client.target.has_room = True
    client.send(whole[5:])
    client.release()
    assert client.target.asked == [READ, OTHER_READ]


def test_a_response_leaves_before_the_next_request_is_handed_out(client: Client) -> None:
    """That takes a while, in which the client can give up."""
    client.target.at_once = True
    sent_before = []
    submit = client.target.submit

    def look_and_submit(request: Request, now: float) -> None:
        sent_before.append(client.connection.sent)
        submit(request, now)

    client.target.submit = look_and_submit
    client.ask(READ, OTHER_READ)
    assert sent_before == [b"", client.encode(7, RESPONSE)]
    assert client.heard(RESPONSE, OTHER_RESPONSE)


def test_a_pause_of_fifty_milliseconds_is_no_stand_still(client: Client) -> None:
    client.stand_still(TOGETHER)
    client.ask(READ, OTHER_READ)
    client.respond(0)
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(RESPONSE, OTHER_RESPONSE)


# --- a request that is found behind noise, long after it came ---


NOISE = pytest.mark.parametrize("noise", [b"\xff", b"\x01\x80", bytes.fromhex("07 10 00")])


@pytest.mark.parametrize("at_once", [False, True])
@pytest.mark.parametrize("time_out", [0.06, 0.1, 0.24])
@NOISE
def test_of_requests_that_are_found_behind_noise_none_is_answered(
    rtu_client: Client, noise: bytes, time_out: float, *, at_once: bool
) -> None:
    """The last one may be a new request, or one of several that were sent together: nobody knows when each arrived."""
    rtu_client.target.at_once = at_once
    rtu_client.send(noise)
    rtu_client.ask(READ)
    rtu_client.wait(time_out)
    rtu_client.ask(OTHER_READ)
    rtu_client.wait(SILENCE)
    assert rtu_client.target.asked == []
    assert rtu_client.heard()
    rtu_client.target.at_once = False
    asks_anew(rtu_client)


@pytest.mark.parametrize("pause", [0.0, 0.04, 0.2])
@NOISE
def test_a_single_request_that_is_found_behind_noise_is_answered(
    rtu_client: Client, noise: bytes, pause: float
) -> None:
    rtu_client.send(noise)
    rtu_client.wait(pause)
    rtu_client.ask(READ)
    rtu_client.wait(SILENCE)
    rtu_client.respond(0)
    assert rtu_client.heard(RESPONSE)
    asks_anew(rtu_client)


@NOISE
def test_requests_that_arrive_together_with_noise_are_all_answered(rtu_client: Client, noise: bytes) -> None:
    rtu_client.target.at_once = True
    rtu_client.wait(TIME_OUT)
    rtu_client.send(noise)
    rtu_client.ask(READ)
    rtu_client.wait(0.6 * TOGETHER)
    rtu_client.ask(OTHER_READ, READ)
    rtu_client.wait(SILENCE)
    assert rtu_client.heard(RESPONSE, OTHER_RESPONSE, RESPONSE)


def test_a_request_behind_noise_replaces_one_that_is_certainly_older(rtu_client: Client) -> None:
    rtu_client.ask(READ)
    rtu_client.wait(TIME_OUT)
    rtu_client.send(b"\xff")
    rtu_client.ask(OTHER_READ)
    rtu_client.wait(SILENCE)
    rtu_client.respond(0)
    assert rtu_client.target.asked == [READ, OTHER_READ]
    rtu_client.respond(1, OTHER_RESPONSE)
    assert rtu_client.heard(OTHER_RESPONSE)


def test_a_client_that_asks_on_behind_noise_without_a_silence_gets_the_last_response_only(rtu_client: Client) -> None:
    """Noise ends before a silence too: no frame is so long."""
    rtu_client.target.at_once = True
    rtu_client.send(b"\xff")
    count = 0
    while not rtu_client.connection.sent:
        rtu_client.wait(0.1)
        rtu_client.ask(READ if count % 2 else OTHER_READ)
        count += 1
        assert count < 40
    assert rtu_client.heard(OTHER_RESPONSE if count % 2 else RESPONSE)


def test_one_whose_bytes_came_one_by_one_is_found_behind_noise(rtu_client: Client) -> None:
    for byte in b"\xff" + rtu_client.encode(7, READ):
        rtu_client.send(bytes((byte,)))
        rtu_client.wait(0.1)
    rtu_client.wait(SILENCE)
    assert rtu_client.target.asked == [READ]


def test_of_requests_behind_noise_none_is_awaited_when_another_has_begun_later(rtu_client: Client) -> None:
    rtu_client.send(b"\xff")
    rtu_client.ask(READ)
    rtu_client.wait(0.1)
    rtu_client.send(rtu_client.encode(7, OTHER_READ)[:5])
    rtu_client.wait(SILENCE)
    assert rtu_client.target.asked == []
    assert rtu_client.session.is_idle


def test_the_same_request_again_is_later_though_it_begins_together_with_the_first(client: Client) -> None:
    whole = client.encode(7, READ)
    client.send(whole + whole[:3])
    client.wait(SILENCE * 0.8)
    client.send(whole[3:])
    client.respond(0, OTHER_RESPONSE)
    assert client.heard()
    client.respond(1)
    assert client.heard(RESPONSE)


# --- unit 0 ---


def test_nobody_hears_anything_of_unit_0(client: Client) -> None:
    client.ask(WRITE, unit=0)
    client.ask(READ)
    assert [request.unit for request in client.target.requests] == [0, 7]
    client.target.requests[0].respond(WRITE)
    client.respond(1)
    assert client.heard(RESPONSE)
    assert client.session.is_idle


def test_a_broadcast_is_not_given_up(client: Client) -> None:
    client.ask(WRITE, unit=0)
    client.wait(TIME_OUT)
    client.ask(READ)
    assert all(map(client.session.wants, client.target.requests))
    client.target.requests[0].end()
    client.respond(1)
    assert client.heard(RESPONSE)


def test_a_broadcast_keeps_its_place_and_goes_out_though_what_was_before_it_is_given_up(client: Client) -> None:
    client.send(client.encode(7, READ) + client.encode(7, READ) + client.encode(0, WRITE))
    assert client.target.asked == [READ]
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    assert client.target.asked == [READ, WRITE, OTHER_READ]
    client.target.requests[1].end()
    client.respond(2)
    assert client.heard(RESPONSE)
    assert client.session.is_idle


def test_no_more_broadcasts_are_under_way_than_requests_may_be() -> None:
    client = Client("rtu+tcp", in_flight=2)
    client.ask(*[WRITE] * 9, unit=0)
    under_way = len(client.target.requests)
    assert under_way == 3  # and one, as behind an awaited request
    for ended in range(9):
        assert len(client.target.requests) == min(9, under_way + ended)
        client.target.requests[ended].end()
        client.wait(0.0)
    assert client.session.is_idle


def test_of_too_many_broadcasts_the_last_are_dropped() -> None:
    client = Client("rtu+tcp", in_flight=4)
    most = 4 + 1 + MOST_BROADCASTS
    client.ask(*[WRITE] * (most + 9), unit=0)
    assert not client.connection.is_paused
    for number in range(most):
        client.target.requests[number].end()
        client.wait(0.0)
    assert len(client.target.requests) == most
    assert client.session.is_idle
    client.ask(WRITE, unit=0)
    assert len(client.target.requests) == most + 1


@pytest.mark.parametrize("before", [1, 24, 200])
@pytest.mark.parametrize("behind", [0, 24, 200])
@pytest.mark.parametrize("in_flight", [1, 16])
@pytest.mark.parametrize("scheme", ENCODE)
def test_a_time_out_is_noticed_however_many_broadcasts_there_are(
    scheme: str, in_flight: int, before: int, behind: int
) -> None:
    client = Client(scheme, in_flight=in_flight)
    client.ask(*[WRITE] * before, unit=0)
    client.ask(READ)
    client.ask(*[WRITE] * behind, unit=0)
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    for request in client.target.requests:
        if request.unit == 0:
            request.end()
        else:
            request.respond(RESPONSE if request.pdu == READ else OTHER_RESPONSE)
        client.wait(0.0)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


@pytest.mark.parametrize("scheme", ENCODE)
def test_a_unit_that_answers_for_unit_0_is_heard(scheme: str) -> None:
    client = Client(scheme, unit0=41)
    client.ask(READ, unit=0)
    client.respond(0)
    assert client.heard(RESPONSE, unit=0)


# --- what is no request ---


def test_silence_ends_a_frame_of_unknown_size(rtu_client: Client) -> None:
    rtu_client.ask(UNKNOWN)
    assert rtu_client.target.asked == []
    rtu_client.wait(SILENCE)
    assert rtu_client.target.asked == [UNKNOWN]


def test_one_of_unknown_size_may_come_together_with_others(rtu_client: Client) -> None:
    """Its end is noticed later than it has come."""
    rtu_client.ask(READ, UNKNOWN)
    rtu_client.wait(SILENCE)
    rtu_client.respond(0)
    rtu_client.respond(1, UNKNOWN)
    assert rtu_client.heard(RESPONSE, UNKNOWN)


def test_a_request_behind_one_of_unknown_size_is_found_though_nobody_looked_in_time(rtu_client: Client) -> None:
    rtu_client.ask(UNKNOWN)
    rtu_client.now += SILENCE
    rtu_client.session.look(rtu_client.now)
    rtu_client.ask(READ)
    rtu_client.respond(0)
    assert rtu_client.target.asked == [READ]
    assert rtu_client.heard(RESPONSE)


@pytest.mark.parametrize("cut", range(1, 8))
def test_half_a_frame_is_forgotten_after_a_silence(rtu_client: Client, cut: int) -> None:
    rtu_client.send(rtu_client.encode(7, READ)[:cut])
    rtu_client.wait(SILENCE)
    rtu_client.ask(READ)
    rtu_client.respond(0)
    assert rtu_client.heard(RESPONSE)


def test_noise_and_wrong_check_sums_are_not_answered_and_what_follows_is(client: Client) -> None:
    broken = bytearray(client.encode(7, READ))
    broken[5] ^= 1
    for noise in (bytes(broken), b"\xff\x00noise", client.encode(7, READ)[:-3], bytes(300)):
        client.send(noise)
        client.wait(SILENCE)
        client.ask(READ)
        client.wait(SILENCE)
        client.respond(-1)
        assert client.heard(RESPONSE)
        assert client.connection.log == []


def test_a_function_that_no_request_has_is_handed_on_as_over_modbus_tcp(client: Client) -> None:
    client.ask(b"\x83\x02")
    client.wait(SILENCE)
    assert client.target.asked == [b"\x83\x02"]


@pytest.mark.parametrize("noise", [b"GET / HTTP/1.1\r\n", b"\x16\x03\x01\x02\x00", b"\xff", b"\0", b":0"])
def test_a_client_that_speaks_something_else_is_sent_away(client: Client, noise: bytes) -> None:
    client.ask(READ)
    client.wait(TIME_OUT)
    client.send(noise * (MOST_NOISE + 1))
    assert client.connection.log[0].startswith("reject: ")
    assert client.connection.log[0].endswith(" bytes without a request")
    assert client.session.gone
    client.target.requests[0].respond(RESPONSE)
    assert client.heard()


def test_noise_is_counted_from_the_last_request_on(client: Client) -> None:
    client.target.at_once = True
    for _ in range(5):
        client.send(b"\xff" * (MOST_NOISE // 2))
        client.wait(SILENCE)
        client.ask(READ)
    assert client.connection.log == []


def test_a_frame_that_is_never_finished_is_complained_about(client: Client) -> None:
    """However slowly it comes, and though there is never a silence."""
    drip = client.encode(7, bytes.fromhex("10 00 00 00 7B F6") + bytes(246))
    begun_at = client.now
    for byte in drip:
        client.send(bytes((byte,)))
        if client.session.find_fault(client.now):
            break
        client.wait(SILENCE * 0.8)
    assert client.session.find_fault(client.now) == f"sent no whole request within {SENDING_DEADLINE:g} s"
    assert client.now - begun_at == pytest.approx(SENDING_DEADLINE, abs=1)


# --- who leaves, who does not listen ---


def test_a_client_that_leaves_hears_nothing_and_wants_nothing(client: Client) -> None:
    client.ask(READ, OTHER_READ)
    client.session.closed()
    assert not client.session.wants(client.target.requests[0])
    client.respond(0)
    assert client.heard()
    assert client.target.asked == [READ]


def test_a_session_that_has_ended_does_not_hold_itself_by_what_waited(client: Client) -> None:
    """See `closed`."""

    def remain() -> int:
        return sum(isinstance(each, OverTcpSession) for each in gc.get_objects())

    gc.collect()
    gc.disable()
    try:
        before = remain()
        client.ask(READ, OTHER_READ)
        client.session.closed()
        client.target.requests.clear()
        del client.session
        assert remain() == before - 1
    finally:
        gc.enable()


def test_a_half_closed_client_gets_all_its_responses_first(client: Client) -> None:
    client.ask(READ, OTHER_READ)
    client.session.end_of_input()
    client.respond(0)
    assert client.connection.log == []
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(RESPONSE, OTHER_RESPONSE)
    assert client.connection.log == ["close"]


def test_a_session_that_finishes_answers_what_it_has_taken(client: Client) -> None:
    client.ask(READ, READ)
    client.session.finish()
    client.respond(0)
    client.ask(OTHER_READ)
    client.respond(1)
    assert client.heard(RESPONSE, RESPONSE)
    assert client.target.asked == [READ, READ]
    assert client.connection.log == ["close"]


def test_a_client_that_takes_no_responses_is_asked_nothing_for(client: Client) -> None:
    client.ask(READ, OTHER_READ)
    client.session.block(client.now)
    client.respond(0)
    assert client.target.asked == [READ]
    client.session.unblock()
    client.wait(0.0)
    assert client.target.asked == [READ, OTHER_READ]


def test_its_repr_says_who_it_is(client: Client) -> None:
    client.ask(READ)
    assert repr(client.session) == "<OverTcpSession 10.0.0.9:49152 in_flight=1>"


# --- on_failure = "silent" ---


@pytest.fixture(params=ENCODE)
def patient(request: pytest.FixtureRequest) -> Client:
    """One that is told nothing of failures."""
    return Client(request.param, in_flight=2, on_failure="silent")


def test_nothing_is_said_of_a_failure_and_the_next_request_is_answered(patient: Client) -> None:
    for number in range(5):
        patient.ask(READ)
        patient.fail(2 * number)
        assert patient.session.is_idle
        patient.wait(TIME_OUT)
        patient.ask(OTHER_READ)
        patient.respond(2 * number + 1, OTHER_RESPONSE)
        assert patient.heard(OTHER_RESPONSE)


def test_a_refusal_is_said_and_so_is_an_exception_of_the_unit(patient: Client) -> None:
    patient.ask(READ)
    patient.target.requests[0].fail(IllegalValue())
    patient.ask(READ)
    patient.respond(1, bytes.fromhex("83 0B"))
    assert patient.heard(bytes.fromhex("83 03"), bytes.fromhex("83 0B"))


@pytest.mark.parametrize("count", [2, 3, 4, 200])
def test_what_was_sent_together_with_a_failure_is_not_taken_for_its_answer(patient: Client, count: int) -> None:
    """However many there are: those that wait, those that were read, and those that nobody has read yet."""
    patient.ask(*[READ] * count)
    patient.wait(0.01)
    patient.fail(0)
    while not patient.session.is_idle:
        patient.respond(len(patient.target.requests) - 1)
    assert patient.heard()
    patient.wait(TIME_OUT)
    patient.ask(OTHER_READ)
    assert patient.target.asked == [READ, OTHER_READ]
    patient.respond(1, OTHER_RESPONSE)
    assert patient.heard(OTHER_RESPONSE)


def test_a_request_behind_a_failure_that_nobody_has_read_yet_is_answered(patient: Client) -> None:
    patient.ask(READ)
    patient.wait(TIME_OUT)
    patient.connection.unread = patient.encode(7, OTHER_READ)
    patient.fail(0)
    patient.wait(0.0)
    assert patient.target.asked == [READ]
    patient.send(patient.connection.unread)
    patient.respond(1, OTHER_RESPONSE)
    assert patient.heard(OTHER_RESPONSE)


def test_a_broadcast_goes_out_though_what_was_sent_before_it_has_failed(patient: Client) -> None:
    patient.send(patient.encode(7, READ) + patient.encode(0, WRITE) + patient.encode(7, READ))
    patient.fail(0)
    assert [request.unit for request in patient.target.requests] == [7, 0]
    patient.target.requests[1].end()
    assert patient.session.is_idle
    assert patient.heard()


def test_a_failure_at_once_is_a_failure(patient: Client) -> None:
    """Before the target has returned."""

    def submit(request: Request, now: float) -> None:
        request.fail(ResponseTimeout())

    patient.target.submit = submit
    patient.ask(READ, READ, READ)
    assert patient.heard()
    assert patient.session.is_idle
    assert not patient.connection.is_paused


def test_a_response_that_is_kept_leaves_though_the_client_is_held_back(client: Client) -> None:
    client.ask(READ)
    client.connection.unread = client.encode(7, OTHER_READ)
    client.target.requests[0].fail(QueueFull())
    assert client.connection.held_for
    client.wait(0.0)
    assert client.heard(bytes.fromhex("83 06"))
    assert client.target.asked == [READ]
    client.release()
    assert client.target.asked == [READ, OTHER_READ]
    client.respond(1, OTHER_RESPONSE)
    assert client.heard(OTHER_RESPONSE)
    assert client.session.is_idle


def test_a_request_while_the_session_finishes_shows_that_the_awaited_one_is_given_up(client: Client) -> None:
    client.ask(READ)
    client.session.finish()
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(0)
    assert client.heard()


def test_it_shows_that_those_that_wait_behind_are_given_up_too(client: Client) -> None:
    client.ask(READ, READ)
    client.session.finish()
    client.respond(0)
    client.wait(0.0)
    client.wait(TIME_OUT)
    client.ask(OTHER_READ)
    client.respond(1)
    assert client.heard(RESPONSE)


@pytest.mark.parametrize("scheme", ENCODE)
@pytest.mark.parametrize("in_flight", [1, 3])
def test_a_response_that_is_ready_at_once_waits_for_what_came_in_a_stand_still(scheme: str, in_flight: int) -> None:
    """The gateway stands still when it has read requests; meanwhile their client gives them up, and asks another."""
    client = Client(scheme, in_flight=in_flight)
    client.wait(0.03)
    client.target.at_once = True
    submit = client.target.submit

    def stand_still_and_submit(request: Request, now: float) -> None:
        client.target.submit = submit
        client.stand_still(TIME_OUT)
        client.connection.unread = client.encode(7, OTHER_READ)
        submit(request, now)

    client.target.submit = stand_still_and_submit
    client.ask(READ, READ)
    client.wait(TIME_OUT)
    assert client.connection.sent == b""
    client.ask(READ)
    assert client.connection.sent == client.encode(7, RESPONSE)


def test_who_does_not_go_on_is_at_fault_and_that_is_all_that_is_said() -> None:
    client = Client("ascii+tcp")
    client.send(b":0103")
    assert client.session.find_fault(client.now + 1.0) == ""
    assert client.session.find_fault(client.now + 20.0) == "sent no whole request within 10 s"
