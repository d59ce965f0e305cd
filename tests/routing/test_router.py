"""Which target gets a request, and who is refused."""

import pytest

from gateway.events import AccessDenied, Event, RequestRefused
from gateway.request import Request
from gateway.routing.access import may_write
from gateway.routing.router import Counts, Router
from kit.asker import Asker


class Echo:
    """A Target that answers with the request."""

    def submit(self, request: Request, now: float) -> None:
        request.respond(request.pdu)


def ask(pdu: str, unit: int = 7, *, writes: bool = True) -> tuple[list[str | None], list[Event]]:
    events: list[Event] = []
    client = Asker("10.0.0.9:49152", may_write=writes)
    Router({7: Echo()}, events.append).submit(client.ask(pdu, unit=unit), 0.0)
    return client.answers, events


def test_a_request_goes_to_its_unit() -> None:
    assert ask("03 00 00 00 01") == (["03 00 00 00 01"], [])


@pytest.mark.parametrize("pdu", ["03 00 00 00 01", "2B 0E 01 00", "08 00 00 12 34"])
@pytest.mark.parametrize("unit", [0, 99, 248, 255])
def test_a_unit_without_a_route_is_answered_0a_whatever_the_function(pdu: str, unit: int) -> None:
    function = int(pdu[:2], 16)
    told = RequestRefused("10.0.0.9:49152", unit, function, "0A", "no such unit")
    assert ask(pdu, unit) == ([f"{function | 0x80:02X} 0A"], [told])


@pytest.mark.parametrize("function", [1, 2, 3, 4, 7, 11, 12, 17, 20, 24])
def test_a_reader_may_read(function: int) -> None:
    pdu = f"{function:02X} 00 00 00 01"
    assert ask(pdu, writes=False) == ([pdu], [])


@pytest.mark.parametrize("pdu", ["2B 0E 01 00", "2B 0E 04 02", "2B 0E"])
def test_a_reader_may_ask_what_a_device_is(pdu: str) -> None:
    assert ask(pdu, writes=False) == ([pdu], [])


@pytest.mark.parametrize("pdu", ["2B", "2B 0D 01 00", "2B 00 0E 00", "2B FF", "AB 0E 01 00"])
def test_function_43_is_a_write_for_whatever_else_it_carries(pdu: str) -> None:
    answers, events = ask(pdu, writes=False)
    assert answers == [f"{int(pdu[:2], 16) | 0x80:02X} 01"]
    assert [type(event) for event in events] == [AccessDenied]


@pytest.mark.parametrize("function", [5, 6, 8, 15, 16, 21, 22, 23, 43, 65, 100])
def test_a_reader_may_use_nothing_that_could_write(function: int) -> None:
    answers, events = ask(f"{function:02X} 00 00 00 01", writes=False)
    assert answers == [f"{function | 0x80:02X} 01"]
    assert events == [AccessDenied("10.0.0.9:49152", 7, function)]


@pytest.mark.parametrize(
    ("host", "writes"),
    [
        ("127.0.0.1", True),
        ("127.8.9.1", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("10.0.0.9", False),
        ("::ffff:10.0.0.9", False),
        ("fe80::1%eth0", False),
    ],
)
def test_only_clients_of_this_machine_may_write(host: str, writes: bool) -> None:
    assert may_write(host) is writes


def test_what_reaches_no_target_is_counted() -> None:
    router = Router({7: Echo()}, lambda event: None)
    reader = Asker(may_write=False)
    for unit, pdu in ((7, "03 00 00 00 01"), (7, "06 00 00 00 01"), (8, "03 00 00 00 01"), (8, "06 00 00 00 01")):
        router.submit(reader.ask(pdu, unit=unit), 0.0)
    assert router.counts == Counts(no_route=2, denied=1)
