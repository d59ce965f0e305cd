"""Functions 08, 11 and 12 of an image, beyond the cases of the specification."""

from dataclasses import replace

import pytest

from gateway.errors import Busy, DeviceFailure, NoRoute, RequestError
from gateway.images.persistent import PersistentImage
from gateway.images.services import Diagnostics
from gateway.request import Request
from images.asking import Answers, ask, broadcast, image
from images.disk import Disk


def request(pdu: str = "03 0000 0001", unit: int = 10) -> Request:
    return Request(unit, bytes.fromhex(pdu), Answers(), received_at=0.0)


def log(diagnostics: Diagnostics) -> str:
    return diagnostics.event_log(b"\x0c")[8:].hex(" ").upper()


def test_a_broadcast_is_a_message_without_a_response():
    plain = image(holding=((0, 3),))
    broadcast(plain, "06 0000 0001")
    broadcast(plain, "06 0009 0001")
    assert ask(plain, "08 000F 0000") == "08 00 0F 00 02"
    assert ask(plain, "08 000E 0000") == "08 00 0E 00 04"
    assert ask(plain, "08 000D 0000") == "08 00 0D 00 00"


def test_a_broadcast_in_the_log():
    """Nobody was sent an exception; only what was performed is an event."""
    plain = image(holding=((0, 3),))
    broadcast(plain, "06 0000 0001")
    broadcast(plain, "06 0009 0001")
    assert ask(plain, "0C") == "0C 0B 00 00 00 01 00 03 80 40 C0 40 C0"


@pytest.mark.parametrize(
    ("error", "byte"),
    [(DeviceFailure(), "42"), (Busy(), "44"), (NoRoute(), "40")],
)
def test_the_log_tells_kinds_of_exceptions(error: RequestError, byte: str):
    diagnostics = Diagnostics()
    diagnostics.refused(request(), error.code)
    assert log(diagnostics) == byte


def test_the_log_keeps_the_last_64_events():
    plain = image(holding=((0, 3),))
    ask(plain, "41")
    for _ in range(32):
        ask(plain, "03 0000 0001")
    assert ask(plain, "0C") == "0C 46 00 00 00 20 00 22 " + " ".join(["80", *["40", "80"] * 31, "40"])


def test_clearing_the_counters_leaves_the_log():
    plain = image(holding=((0, 3),))
    ask(plain, "41")
    ask(plain, "08 000A 0000")
    assert ask(plain, "0C") == "0C 0B 00 00 00 01 00 01 80 40 80 41 80"


def test_counters_wrap_round():
    diagnostics, asking = Diagnostics(), request()
    for _ in range(0x10001):
        diagnostics.received(asking)
        diagnostics.done(asking)
    assert diagnostics.counter(0x0B) == 1
    assert diagnostics.event_counter(b"\x0b") == bytes.fromhex("0B 0000 0001")
    assert diagnostics.event_log(b"\x0c")[:8] == bytes.fromhex("0C 46 0000 0001 0001")


def test_what_clients_clear_is_not_what_the_operator_sees():
    plain = image(holding=((0, 3),))
    ask(plain, "41")
    ask(plain, "08 000A 0000")
    assert (plain.counts.requests, plain.counts.exceptions) == (2, 1)


def test_each_image_has_its_own():
    one, other = image(), image()
    ask(one, "41")
    assert ask(other, "08 000D 0000") == "08 00 0D 00 00"


def test_an_image_that_keeps_its_values_counts_like_any_other():
    """Its write is answered later, and the log says so."""
    disk = Disk()
    kept = PersistentImage(replace(image(holding=((0, 3),)).settings, persist="always"), disk)
    kept.start()
    answers = Answers()
    for pdu in ("06 0000 0001", "0B"):
        kept.submit(Request(10, bytes.fromhex(pdu), answers, received_at=0.0), 0.0)
    assert answers.came == []
    disk.keep()
    assert answers.came == [bytes.fromhex("06 0000 0001"), bytes.fromhex("0B 0000 0000")]
    assert ask(kept, "0C") == "0C 0B 00 00 00 01 00 03 80 40 40 80 80"
