"""Which target gets a request, and who is refused."""

import pytest

from gateway.events import AccessDenied, Event, RequestRefused
from gateway.request import NamedTarget, Request
from gateway.routing.access import NOTHING, READING, AccessRow, EntryPoint
from gateway.routing.rights import Rights
from gateway.routing.router import Router, RouterCounts
from gateway.trace.ring import Ring
from kit.asker import Asker
from kit.router import router

#: Under the rights that nobody has written.
WRITER, READER = "127.0.0.1", "10.0.0.9"


class Echo(NamedTarget):
    """A Target that answers with the request."""

    def __init__(self) -> None:
        self.name = "echo"

    def submit(self, request: Request, now: float) -> None:
        request.respond(request.pdu)


def ask(pdu: str, unit: int = 7, *, host: str = WRITER) -> tuple[list[str | None], list[AccessDenied]]:
    events: list[Event] = []
    client = Asker(f"{host}:49152", host=host)
    router({7: Echo()}, events.append).submit(client.ask(pdu, unit=unit), 0.0)
    return client.answers, [event for event in events if isinstance(event, AccessDenied)]


@pytest.mark.parametrize("pdu", ["03 00 00 00 01", "06 00 00 00 01"])
def test_a_request_goes_to_its_unit(pdu: str) -> None:
    assert ask(pdu) == ([pdu], [])


@pytest.mark.parametrize("host", [WRITER, READER])
@pytest.mark.parametrize("pdu", ["03 00 00 00 01", "2B 0E 01 00", "08 00 00 12 34"])
@pytest.mark.parametrize("unit", [0, 99, 248, 255])
def test_a_unit_without_a_route_is_answered_0a_whatever_the_function(pdu: str, unit: int, host: str) -> None:
    assert ask(pdu, unit, host=host) == ([f"{int(pdu[:2], 16) | 0x80:02X} 0A"], [])


def test_an_unknown_unit_is_told() -> None:
    events: list[Event] = []
    router({7: Echo()}, events.append).submit(Asker("10.0.0.9:49152").ask("03 00 00 00 01", unit=9), 0.0)
    assert events == [RequestRefused("10.0.0.9:49152", 9, 3, "0A", "no such unit", "scada")]


@pytest.mark.parametrize("function", [1, 2, 3, 4, 7, 11, 12, 17, 20, 24])
def test_a_reader_may_read(function: int) -> None:
    pdu = f"{function:02X} 00 00 00 01"
    assert ask(pdu, host=READER) == ([pdu], [])


@pytest.mark.parametrize("pdu", ["2B 0E 01 00", "2B 0E 04 02", "2B 0E"])
def test_a_reader_may_ask_what_a_device_is(pdu: str) -> None:
    assert ask(pdu, host=READER) == ([pdu], [])


@pytest.mark.parametrize("pdu", ["2B", "2B 0D 01 00", "2B 00 0E 00", "2B FF", "AB 0E 01 00"])
def test_function_43_is_a_write_for_whatever_else_it_carries(pdu: str) -> None:
    answers, denied = ask(pdu, host=READER)
    assert answers == [f"{int(pdu[:2], 16) | 0x80:02X} 01"]
    assert len(denied) == 1


@pytest.mark.parametrize("function", [5, 6, 8, 15, 16, 21, 22, 23, 43, 65, 100])
def test_a_reader_may_use_nothing_that_could_write(function: int) -> None:
    answers, denied = ask(f"{function:02X} 00 00 00 01", host=READER)
    assert answers == [f"{function | 0x80:02X} 01"]
    assert denied == [AccessDenied("scada", "10.0.0.9:49152", 7, function)]


def test_what_reaches_no_target_is_counted() -> None:
    made, reader = router({7: Echo()}), Asker(host=READER)
    for unit, pdu in ((7, "03 00 00 00 01"), (7, "06 00 00 00 01"), (8, "03 00 00 00 01"), (8, "06 00 00 00 01")):
        made.submit(reader.ask(pdu, unit=unit), 0.0)
    assert made.counts == RouterCounts(no_route=2, denied=1)


def test_what_reaches_no_target_is_in_the_trace() -> None:
    ring, reader = Ring(2**16), Asker(host=READER)
    made = Router(EntryPoint("scada"), lambda: 0.0, [].append, ring=ring)
    made.routes, made.rights = {7: Echo()}, Rights([AccessRow(READING)], made.entry)
    for unit, pdu in ((8, "03 00 00 00 01"), (7, "06 00 00 00 01"), (7, "03 00 00 00 01")):
        made.submit(reader.ask(pdu, unit=unit), 0.0)
    assert [(record.unit, record.error.result) for record in ring.after(0)] == [(8, "no_route"), (7, "denied")]


def test_other_rights_hold_from_the_next_request_on() -> None:
    made, client = router({7: Echo()}), Asker(host=WRITER)
    for right in (READING, NOTHING):
        made.submit(client.ask("06 00 00 00 01", unit=7), 0.0)
        made.submit(client.ask("03 00 00 00 01", unit=7), 0.0)
        made.rights = Rights([AccessRow(right)], EntryPoint("scada"))
    made.submit(client.ask("03 00 00 00 01", unit=7), 0.0)
    assert client.answers == ["06 00 00 00 01", "03 00 00 00 01", "86 01", "03 00 00 00 01", "83 01"]
