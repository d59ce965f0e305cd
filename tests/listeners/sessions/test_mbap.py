"""One client's connection: every request gets exactly one response, and all of it is bounded."""

import pytest

from gateway.errors import (
    AccessDenied,
    IllegalFunction,
    IllegalValue,
    LineDown,
    NoRoute,
    QueueFull,
    RequestError,
    ResponseTimeout,
    WaitedTooLong,
)
from gateway.listeners.sessions.mbap import MbapSession
from gateway.listeners.sessions.session import LONGEST_HOLD, SENDING_DEADLINE, SHORTEST_HOLD, TAKING_DEADLINE
from gateway.listeners.sessions.session import Connection as AnyConnection
from gateway.listeners.settings import ListenSettings
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.mbap import encode
from gateway.request import Caller, Request
from gateway.request import Target as AnyTarget

READ = bytes.fromhex("03 00 10 00 01")
RESPONSE = bytes.fromhex("03 02 01 10")
OTHER_RESPONSE = bytes.fromhex("03 02 02 20")


class Target(AnyTarget):
    """A Target that keeps its requests, or answers at once."""

    def __init__(self) -> None:
        self.at_once = False
        self.error: RequestError | None = None
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)
        if self.at_once:
            request.respond(RESPONSE)
        elif self.error is not None:
            request.fail(self.error)


class Connection(AnyConnection):
    """What the session does to its connection, as one list."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.log: list[str] = []
        self.held_for: list[float] = []
        self.unread = b""
        #: How often it was read, and whether it is to call `proceed` soon.
        self.looks = 0
        self.wakes = False
        self.now = 1.0

    def time(self) -> float:
        return self.now

    def receive(self, room: memoryview) -> int:
        self.looks += 1
        part, self.unread = self.unread[: len(room)], self.unread[len(room) :]
        room[: len(part)] = part
        return len(part)

    def wake(self, when: float | None) -> None:
        self.wakes = when is not None

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        self.log.append("send")

    def pause(self) -> None:
        self.log.append("pause")

    def resume(self) -> None:
        self.log.append("resume")

    def release_after(self, seconds: float) -> None:
        self.held_for.append(seconds)

    def close(self) -> None:
        self.log.append("close")

    def reject(self, reason: str) -> None:
        self.log.append("reject: " + reason)


class Client:
    """A session with a client in the test's hands; at most three requests under way."""

    def __init__(self, **settings: str) -> None:
        self.target = Target()
        self.connection = Connection()
        self.session = MbapSession(
            Caller("10.0.0.9:49152", "127.0.0.1", "127.0.0.1"),
            router=self.target,
            connection=self.connection,
            settings=ListenSettings("scada", "::", 502, in_flight=3, **settings),
            now=0.0,
        )

    def send(self, data: bytes, now: float = 1.0) -> None:
        while data:
            room = self.session.room()
            part, data = data[: len(room)], data[len(room) :]
            room[: len(part)] = part
            self.session.received(len(part), now)

    def ask(self, *transactions: int, unit: int = 7) -> None:
        self.send(b"".join(encode(each, unit, READ) for each in transactions))

    def ask_again(self) -> None:
        """What the connection does after `resume`, and does in vain before."""
        self.session.proceed(2.0)


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
    client.session.block(1.0)
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


#: RTU requests from address 0, 5 and 600 on: what is read as an MBAP header differs.
RTU_READS = [f"03 {address:04X} {count:04X}" for address in (0, 5, 600) for count in (1, 2, 10, 100)]


@pytest.mark.parametrize("read", RTU_READS)
@pytest.mark.parametrize("error", [NoRoute(), IllegalFunction()])
def test_a_client_that_sends_rtu_is_rejected_and_told_what_is_for_it(
    client: Client, read: str, error: RequestError
) -> None:
    client.target.error = error
    for now in range(14):  # the header of the longest promises 106 bytes
        if not client.session.gone:
            client.send(rtu.encode(1, bytes.fromhex(read)), float(now))
    rejected = [each for each in client.connection.log if each.startswith("reject")]
    assert len(rejected) == 1
    assert rejected[0].endswith(": this looks like RTU, which rtu+tcp:// is for")


@pytest.mark.parametrize("read", RTU_READS)
def test_the_same_goes_for_ascii(client: Client, read: str) -> None:
    client.send(ascii_framing.encode(1, bytes.fromhex(read)))
    assert client.connection.log[0].startswith("reject: ")
    assert client.connection.log[0].endswith(": this looks like ASCII, which ascii+tcp:// is for")


def test_what_an_rtu_client_has_begun_is_named_when_it_takes_too_long(client: Client) -> None:
    client.send(rtu.encode(1, bytes.fromhex("03 0000 0010")))
    assert client.session.find_fault(2.0) == ""
    fault = client.session.find_fault(2.0 + SENDING_DEADLINE)
    assert fault == "sent no whole request within 10 s: this looks like RTU, which rtu+tcp:// is for"


@pytest.mark.parametrize("error", [NoRoute(), IllegalFunction(), LineDown()])
def test_a_refusal_is_no_reason_to_reject_a_client_of_modbus_tcp(client: Client, error: RequestError) -> None:
    client.target.error = error
    for transaction in range(0x10000):
        client.ask(transaction, unit=transaction & 0xFF)
        assert not client.session.gone


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
    client.send(encode(2, 7, bytes.fromhex("2B 0E 01 00")))
    client.send(encode(3, 7, bytes.fromhex("06 00 01 00 05")))
    requests = client.target.requests
    assert [client.session.wants(each) for each in requests] == [True, True, True]
    client.session.end_of_input()
    assert [client.session.wants(each) for each in requests] == [True, True, False]


def test_what_a_look_has_read_is_answered_although_the_client_has_closed_its_side(client: Client) -> None:
    """The end is seen before what was read is processed. `in_flight` holds for it too."""
    client.ask(1)
    client.connection.unread = b"".join(encode(number, 7, READ) for number in range(2, 7))
    client.target.requests[0].respond(RESPONSE)
    client.session.end_of_input()
    assert client.connection.log == ["send"]
    client.ask_again()
    assert [request.transaction for request in client.target.requests] == [1, 2, 3, 4]
    for request in client.target.requests[1:]:
        request.respond(RESPONSE)
    client.ask_again()
    for request in client.target.requests[4:]:
        request.respond(RESPONSE)
    assert b"".join(client.connection.sent) == b"".join(encode(number, 7, RESPONSE) for number in range(1, 7))
    assert client.connection.log[-1] == "close"


@pytest.mark.parametrize("size", [1, 7, 11])
def test_half_a_request_that_a_look_has_read_keeps_no_half_closed_client(client: Client, size: int) -> None:
    client.ask(1)
    client.connection.unread = encode(2, 7, READ)[:size]
    client.target.requests[0].respond(RESPONSE)
    client.session.end_of_input()
    assert client.connection.log == ["send", "close"]


@pytest.mark.parametrize("order", [1, -1])
def test_a_session_that_finishes_drops_what_a_look_has_read_of_a_half_closed_client(client: Client, order: int) -> None:
    client.ask(1)
    client.connection.unread = encode(2, 7, READ)
    client.target.requests[0].respond(RESPONSE)
    for step in (client.session.finish, client.session.end_of_input)[::order]:
        step()
    assert client.connection.log == ["send", "close"]


def test_a_half_closed_client_without_requests_is_closed(client: Client) -> None:
    client.session.end_of_input()
    assert client.connection.log == ["close"]


def test_it_is_idle_when_nothing_is_under_way_and_knows_when_it_was_last_asked(client: Client) -> None:
    assert client.session.is_idle
    client.send(encode(1, 7, READ), now=5.0)
    assert not client.session.is_idle
    assert client.session.last_asked == 5.0
    assert repr(client.session) == "<MbapSession 10.0.0.9:49152 in_flight=1>"


def test_reading_resumes_only_when_there_is_room_and_the_client_takes_its_responses(client: Client) -> None:
    client.ask(1, 2, 3, 4)
    client.session.block(1.0)
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.log == ["pause", "send"]
    client.ask_again()
    assert len(client.target.requests) == 3
    client.session.unblock()
    assert client.connection.log == ["pause", "send", "resume"]


def test_a_client_that_takes_its_responses_again_still_waits_for_room(client: Client) -> None:
    client.ask(1, 2, 3)
    client.session.block(1.0)
    client.session.unblock()
    assert client.connection.log == ["pause"]


def test_a_client_that_was_never_paused_is_not_resumed(client: Client) -> None:
    client.ask(1)
    client.session.block(1.0)
    client.session.unblock()
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.log == ["send"]


def test_a_half_closed_client_whose_requests_were_answered_at_once_is_closed_at_once(client: Client) -> None:
    client.target.at_once = True
    client.ask(1, 2)
    client.session.end_of_input()
    assert client.connection.log == ["send", "close"]
    assert client.session.gone


def test_a_half_closed_client_is_closed_once_it_has_taken_its_responses(client: Client) -> None:
    client.ask(1)
    client.session.end_of_input()
    client.session.block(1.0)
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.log == ["send"]
    client.session.unblock()
    assert client.connection.log == ["send", "close"]


def test_a_session_that_finishes_answers_what_is_under_way_and_takes_no_more(client: Client) -> None:
    client.ask(1, 2)
    client.session.finish()
    client.ask(3)
    client.target.requests[0].respond(RESPONSE)
    client.ask_again()
    assert [request.transaction for request in client.target.requests] == [1, 2]
    assert client.session.wants(client.target.requests[1])
    client.target.requests[1].respond(RESPONSE)
    assert client.connection.sent == [encode(1, 7, RESPONSE), encode(2, 7, RESPONSE)]
    assert client.connection.log == ["send", "send", "close"]


def test_of_two_requests_with_one_identifier_only_the_later_one_gets_a_response(client: Client) -> None:
    client.ask(0, 0)
    first, second = client.target.requests
    assert [client.session.wants(each) for each in (first, second)] == [False, True]
    first.respond(OTHER_RESPONSE)
    assert client.connection.sent == []
    second.respond(RESPONSE)
    assert client.connection.sent == [encode(0, 7, RESPONSE)]
    assert client.session.is_idle


def test_of_requests_with_one_identifier_that_are_answered_at_once_only_the_latest_gets_a_response(
    client: Client,
) -> None:
    client.target.at_once = True
    client.ask(5, 0, 0)
    assert b"".join(client.connection.sent) == encode(5, 7, RESPONSE) + encode(0, 7, RESPONSE)


@pytest.mark.parametrize("cut", [2, 11, 12])
@pytest.mark.parametrize("before", [(), (0,), (1, 2, 3, 4, 0)])
def test_no_response_leaves_when_its_identifier_stands_unread(
    client: Client, before: tuple[int, ...], cut: int
) -> None:
    """Whether the client had its time-out while the gateway stood still; it may be its first request."""
    client.target.at_once = True
    for each in before:
        client.ask(each)
    client.target.at_once = False
    client.ask(0)
    client.connection.sent.clear()
    whole = encode(0, 7, READ)
    client.connection.unread = whole[:cut]
    client.target.requests[-1].respond(OTHER_RESPONSE)
    assert client.connection.sent == []
    assert client.connection.wakes
    client.ask_again()
    client.send(whole[cut:])
    client.target.requests[-1].respond(RESPONSE)
    assert client.connection.sent == [encode(0, 7, RESPONSE)]
    assert client.session.is_idle


def test_no_response_that_is_ready_at_once_leaves_when_its_identifier_stands_unread(client: Client) -> None:
    client.target.at_once = True
    client.connection.unread = encode(0, 7, READ)
    client.ask(0)
    assert client.connection.sent == []
    client.ask_again()
    assert client.connection.sent == [encode(0, 7, RESPONSE)]


def test_a_response_leaves_when_only_other_identifiers_stand_unread(client: Client) -> None:
    client.ask(0)
    client.connection.unread = encode(1, 7, READ) + encode(2, 7, READ)
    client.target.requests[0].respond(RESPONSE)
    assert client.connection.sent == [encode(0, 7, RESPONSE)]
    client.ask_again()
    assert [request.transaction for request in client.target.requests] == [0, 1, 2]


def test_a_client_with_as_many_requests_under_way_as_it_may_have_gives_up_as_others_do(client: Client) -> None:
    """Its later request is not processed before there is room for it."""
    client.ask(3, 2, 1)
    client.ask(1)
    assert client.connection.log == ["pause"]
    client.connection.unread = encode(2, 7, READ)
    client.target.requests[2].respond(OTHER_RESPONSE)
    client.target.requests[1].respond(OTHER_RESPONSE)
    assert client.connection.sent == []
    client.ask_again()
    for request in client.target.requests[3:]:
        request.respond(RESPONSE)
    assert client.connection.sent == [encode(1, 7, RESPONSE), encode(2, 7, RESPONSE)]


@pytest.mark.parametrize("step", [1, 3, 256])
def test_a_client_that_counts_is_not_read_before_each_response(client: Client, step: int) -> None:
    client.target.at_once = True
    for number in range(300):
        client.ask(number * step & 0xFFFF)
    before = client.connection.looks
    assert before < 50
    client.ask(7)
    assert client.connection.looks == before + 1


@pytest.mark.parametrize(("waited", "is_looked_for"), [(0.04, False), (0.06, True)])
def test_a_client_that_counts_may_give_up_a_request_that_was_not_answered_soon(
    client: Client, waited: float, *, is_looked_for: bool
) -> None:
    """It takes the next identifier only after a response, and asks something else with the same one."""
    client.target.at_once = True
    for number in range(20):
        client.ask(number)
    client.target.at_once = False
    client.ask(20)
    client.connection.unread = encode(20, 7, bytes.fromhex("03 00 42 00 01"))
    client.connection.now = 1.0 + waited
    client.connection.sent.clear()
    client.target.requests[-1].respond(OTHER_RESPONSE)
    assert client.connection.sent == ([] if is_looked_for else [encode(20, 7, OTHER_RESPONSE)])


def test_a_client_that_is_held_back_does_not_count_any_more(client: Client) -> None:
    """Its requests may have waited for longer than its time-out."""
    client.target.at_once = True
    for number in range(20):
        client.ask(number)
    looks = client.connection.looks
    client.target.at_once = False
    client.ask(*range(20, 24))
    client.target.requests[-1].respond(RESPONSE)
    client.ask_again()
    client.target.requests[-1].respond(RESPONSE)
    assert client.connection.looks == looks + 2


@pytest.mark.parametrize("identifiers", [range(1), range(2), range(16), range(15, -1, -1), range(0, 65536, 0x4000)])
def test_a_client_that_soon_uses_its_identifiers_again_is_read_before_each_response(
    client: Client, identifiers: range
) -> None:
    client.target.at_once = True
    for number in range(100):
        client.ask(identifiers[number % len(identifiers)])
    assert client.connection.looks == 100


def test_a_response_that_was_ready_at_once_is_withdrawn_for_a_later_request_that_waits(client: Client) -> None:
    def submit(request: Request, _now: float) -> None:
        client.target.requests.append(request)
        if request.unit == 8:
            request.respond(OTHER_RESPONSE)

    client.target.submit = submit  # type: ignore[method-assign]
    client.send(encode(0, 8, READ) + encode(0, 7, READ))
    assert client.connection.sent == []
    client.target.requests[1].respond(RESPONSE)
    assert client.connection.sent == [encode(0, 7, RESPONSE)]


def test_a_request_while_the_session_finishes_shows_that_the_one_with_its_identifier_is_given_up(
    client: Client,
) -> None:
    client.ask(0, 1)
    client.session.finish()
    client.ask(0)
    client.target.requests[0].respond(OTHER_RESPONSE)
    assert client.connection.log == []
    client.target.requests[1].respond(RESPONSE)
    assert client.connection.sent == [encode(1, 7, RESPONSE)]
    assert client.connection.log == ["send", "close"]


def test_a_session_that_finishes_without_requests_is_closed_at_once(client: Client) -> None:
    client.session.finish()
    assert client.connection.log == ["close"]


def test_a_session_that_finishes_still_sends_writes_that_wait(client: Client) -> None:
    client.send(encode(1, 7, bytes.fromhex("06 00 01 00 05")))
    client.session.finish()
    assert client.session.wants(client.target.requests[0])


# --- what a client may not do for long ---

#: How often complaints are asked for, in seconds.
STEP = 0.5
LATE = "sent no whole request within 10 s"
UNTAKEN = "took no responses for 30 s"


def watch(client: Client, begin: float, end: float, drip: bytes = b"") -> float | None:
    """Ask for complaints from `begin` to `end`, a byte of `drip` before each; when there was one."""
    now = begin
    while now < end:
        piece, drip = drip[:1], drip[1:]
        if piece:
            client.send(piece, now)
        if client.session.find_fault(now):
            return now
        now += STEP
    return None


@pytest.mark.parametrize("begun_at", [100.0, 100.1, 100.4])
def test_an_adu_that_stays_half_sent_is_complained_about_after_ten_seconds(client: Client, begun_at: float) -> None:
    assert watch(client, 0, begun_at) is None
    client.send(encode(1, 7, READ)[:6], begun_at)
    assert watch(client, 100.5, 200) == pytest.approx(begun_at + SENDING_DEADLINE, abs=STEP)
    assert client.session.find_fault(200) == LATE


def test_the_deadline_counts_from_the_first_byte_not_from_the_latest(client: Client) -> None:
    assert watch(client, 0, 200, drip=bytes.fromhex("0001 0000 00FE") + bytes(250)) == pytest.approx(10, abs=STEP)


def test_the_deadline_of_an_adu_begins_after_the_one_before_it(client: Client) -> None:
    """A client that sends in pieces of any size is never late as long as it completes its requests."""
    client.target.at_once = True
    requests = b"".join(encode(each, 7, READ) for each in range(100))
    assert watch(client, 0, 600, drip=requests) is None
    assert len(client.target.requests) == 100


def test_what_waits_because_of_us_is_not_late(client: Client) -> None:
    client.ask(1, 2, 3, 4)
    client.send(encode(5, 7, READ)[:6])
    assert watch(client, 0, 100) is None
    for request in list(client.target.requests):
        request.respond(RESPONSE)
    client.session.proceed(100.0)
    assert watch(client, 100.0, 200) == pytest.approx(100 + SENDING_DEADLINE, abs=STEP)


def test_a_client_that_takes_no_responses_is_complained_about_after_thirty_seconds(client: Client) -> None:
    client.session.block(7.0)
    assert watch(client, 7, 100) == 7 + TAKING_DEADLINE
    assert client.session.find_fault(100) == UNTAKEN


def test_a_client_that_takes_its_responses_late_is_not_complained_about(client: Client) -> None:
    client.session.block(7.0)
    assert watch(client, 7, 36) is None
    client.session.unblock()
    assert watch(client, 36, 100) is None
    client.session.block(100.0)
    assert watch(client, 100, 200) == 100 + TAKING_DEADLINE


# --- when a line has no room ---


def refuse(client: Client, at: int = -1) -> None:
    client.target.requests[at].fail(QueueFull())


def test_after_a_request_without_room_the_next_one_is_taken_a_moment_later(client: Client) -> None:
    client.ask(1)
    refuse(client)
    client.ask(2)
    assert len(client.target.requests) == 1
    assert client.connection.log == ["send", "pause"]
    assert client.connection.held_for == [SHORTEST_HOLD]
    client.session.release()
    client.ask_again()
    assert [request.transaction for request in client.target.requests] == [1, 2]


def test_of_requests_in_one_piece_none_is_taken_behind_one_that_found_no_room(client: Client) -> None:
    client.target.error = QueueFull()
    client.ask(1, 2, 3)
    assert len(client.target.requests) == 1
    for _ in range(2):
        client.session.release()
        client.ask_again()
    assert len(client.target.requests) == 3
    assert len(client.connection.held_for) == 3


def test_several_without_room_at_once_are_one_reason_to_wait(client: Client) -> None:
    client.ask(1, 2, 3)
    for at in range(3):
        refuse(client, at)
    assert client.connection.held_for == [SHORTEST_HOLD]


def test_who_asks_again_at_once_waits_longer_each_time_but_never_long(client: Client) -> None:
    for number in range(20):
        client.ask(number)
        refuse(client)
        client.session.release()
    held_for = client.connection.held_for
    assert held_for[:4] == [SHORTEST_HOLD * 2**time for time in range(4)]
    assert held_for[-1] == LONGEST_HOLD


def test_who_is_answered_again_soon_waits_no_longer_than_at_first(client: Client) -> None:
    for number in range(10):
        client.ask(number)
        refuse(client)
        client.session.release()
    for number in range(20):
        client.ask(number)
        client.target.requests[-1].respond(RESPONSE)
    client.ask(1)
    refuse(client)
    assert client.connection.held_for[-1] == SHORTEST_HOLD


@pytest.mark.parametrize("error", [LineDown(), ResponseTimeout(), AccessDenied()])
def test_no_other_failure_makes_a_client_wait(client: Client, error: RequestError) -> None:
    client.ask(1)
    client.target.requests[0].fail(error)
    client.ask(2)
    assert len(client.target.requests) == 2
    assert client.connection.held_for == []


def test_who_has_gone_is_released_without_harm(client: Client) -> None:
    client.ask(1)
    refuse(client)
    client.session.closed()
    client.session.release()
    assert client.connection.log == ["send"]


# --- on_failure = "silent" ---


@pytest.mark.parametrize("error", [ResponseTimeout(), LineDown(), WaitedTooLong()])
def test_nothing_is_said_of_a_failure_and_its_place_is_free_again(error: RequestError) -> None:
    client = Client(on_failure="silent")
    client.ask(1, 2, 3, 4)
    client.target.requests[0].fail(error)
    assert client.connection.log == ["pause", "resume"]
    client.ask_again()
    assert len(client.target.requests) == 4
    client.target.requests[3].respond(RESPONSE)
    assert client.connection.sent == [encode(4, 7, RESPONSE)]


def test_a_refusal_is_said_and_so_is_an_exception_of_the_unit() -> None:
    client = Client(on_failure="silent")
    client.ask(1, 2, 3)
    client.target.requests[0].fail(AccessDenied())
    client.target.requests[1].fail(IllegalValue())
    client.target.requests[2].respond(bytes.fromhex("8306"))
    said = [bytes.fromhex(pdu) for pdu in ("8301", "8303", "8306")]
    assert client.connection.sent == [encode(number, 7, pdu) for number, pdu in enumerate(said, 1)]


# --- a gateway that stands still between reading a request and answering it ---


def test_who_counts_is_looked_at_if_the_request_was_read_long_ago(client: Client) -> None:
    client.target.at_once = True
    for number in range(20):
        client.ask(number)
    client.connection.sent.clear()
    client.connection.unread = encode(20, 7, READ)
    client.connection.now = 1.06  # the request was read at 1.0
    client.ask(20)
    assert client.connection.sent == []


@pytest.mark.parametrize(("before", "early"), [(15, 1), (3, 16), (3, 40)])
def test_what_was_read_early_does_not_show_that_a_client_counts(client: Client, before: int, early: int) -> None:
    """Until it is processed, the gateway may stand still, and the client use the same identifier again."""
    client.target.at_once = True
    for number in range(before):
        client.ask(number)
    last = before + early
    client.connection.unread = b"".join(encode(number, 7, READ) for number in range(before + 1, last + 1))
    client.ask(before)
    client.connection.sent.clear()
    client.connection.now = 2.0
    client.connection.unread = encode(last, 7, READ)
    client.ask_again()
    assert encode(last, 7, RESPONSE) not in b"".join(client.connection.sent)
