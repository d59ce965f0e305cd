"""Each write is told once, with what became of it."""

import pytest

from gateway.errors import IllegalAddress, LineDown, RequestError, ResponseTimeout, Unwanted
from gateway.events import Event, WriteAudit
from gateway.request import NamedTarget, Request
from gateway.routing.broadcast import Broadcast, Recipient
from kit.asker import Asker
from kit.router import router

WRITE = "06 00 10 00 05"
CLIENT = "10.0.0.9:49152"


class Hand(NamedTarget):
    """A Target that keeps requests for the test to finish."""

    def __init__(self) -> None:
        self.name = "hand"
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)


class Bench:
    """A router with a target for units 0 and 7. Its clock stands half a second after the requests."""

    def __init__(self) -> None:
        self.target = Hand()
        self.events: list[Event] = []
        self.client = Asker(CLIENT)
        self.router = router({0: self.target, 7: self.target}, self.events.append, now=0.5)

    def ask(self, pdu: str, unit: int = 7) -> Request:
        self.router.submit(self.client.ask(pdu, unit=unit), 0.0)
        return self.target.requests[-1]

    def told(self) -> list[WriteAudit]:
        return [event for event in self.events if isinstance(event, WriteAudit)]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_write_is_told_when_it_is_answered(bench: Bench) -> None:
    request = bench.ask(WRITE)
    assert bench.events == []
    request.respond(request.pdu)
    assert bench.events == [WriteAudit(CLIENT, "scada", 7, 6, 0x10, 1, "ok", "", 500.0)]
    assert bench.client.answers == [WRITE]


@pytest.mark.parametrize("pdu", ["03 00 00 00 01", "2B 0E 01 00", "14 07 06 00 01 00 00 00 01"])
def test_a_read_is_not(bench: Bench, pdu: str) -> None:
    bench.ask(pdu).respond(b"\x00")
    assert bench.events == []


@pytest.mark.parametrize(
    ("pdu", "address", "count"),
    [
        ("05 00 01 FF 00", 1, 1),
        ("0F 00 02 00 09 02 FF 01", 2, 9),
        ("10 00 03 00 02 04 00 01 00 02", 3, 2),
        ("16 00 04 00 F2 00 25", 4, 1),
        ("17 00 00 00 05 00 06 00 01 02 00 07", 6, 1),
        ("08 00 00 12 34", None, None),
        ("41 01 02", None, None),
        ("2B 0D 01", None, None),
        ("10 00 03 00 02", None, None),
    ],
)
def test_what_was_to_be_written(bench: Bench, pdu: str, address: int | None, count: int | None) -> None:
    bench.ask(pdu).respond(bytes.fromhex(pdu))
    (told,) = bench.told()
    assert (told.function, told.address, told.count) == (bytes.fromhex(pdu)[0], address, count)


def test_an_exception_of_the_unit(bench: Bench) -> None:
    bench.ask(WRITE).respond(b"\x86\x04")
    assert [(told.result, told.code) for told in bench.told()] == [("exception", "04")]


@pytest.mark.parametrize(
    ("error", "result", "code"),
    [
        (ResponseTimeout(), "timeout", "0B"),
        (IllegalAddress(), "refused", "02"),
        (Unwanted(), "unwanted", "06"),
    ],
)
def test_why_there_is_no_answer_of_the_unit(bench: Bench, error: RequestError, result: str, code: str) -> None:
    bench.ask(WRITE).fail(error)
    assert [(told.result, told.code) for told in bench.told()] == [(result, code)]


def test_a_write_that_nobody_answers(bench: Bench) -> None:
    bench.ask("08 00 04 00 00").end()
    assert [(told.result, told.code) for told in bench.told()] == [("ok", "")]


def test_a_broadcast_is_told_once_and_when_all_have_it(bench: Bench) -> None:
    bench.router.routes[5] = Broadcast([Recipient(bench.target), Recipient(bench.target)])
    copy = bench.ask(WRITE, 5)
    copy.end()
    assert bench.told() == []
    bench.target.requests[0].fail(LineDown())
    assert [(told.unit, told.result, told.code) for told in bench.told()] == [(5, "broadcast", "")]


def test_writes_that_reach_no_unit(bench: Bench) -> None:
    reader = Asker(host="10.0.0.9")
    bench.router.submit(reader.ask(WRITE, unit=7), 0.0)
    bench.router.submit(reader.ask(WRITE, unit=8), 0.0)
    assert [(told.unit, told.result, told.code) for told in bench.told()] == [
        (7, "denied", "01"),
        (8, "no_route", "0A"),
    ]


def test_the_client_decides_whether_it_is_still_to_be_sent(bench: Bench) -> None:
    request = bench.ask(WRITE)
    assert request.origin.wants(request)
    bench.client.gone = True
    assert not request.origin.wants(request)


def test_a_write_to_bits_is_told_as_what_went_to_the_line(bench: Bench) -> None:
    request = bench.client.ask("16 00 08 FF EF 00 10", unit=7)
    request.in_one_turn = 6
    bench.router.submit(request, 0.0)
    request.respond(request.pdu)
    assert bench.told() == [WriteAudit(CLIENT, "scada", 7, 6, 8, 1, "ok", "", 500.0)]
