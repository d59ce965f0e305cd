"""Who has written last to an image."""

from gateway.images.last_writes import MOST, LastWrites
from gateway.request import Caller, Origin, Request


class Client(Origin):
    def __init__(self, name: str) -> None:
        self.caller = Caller.without_address(name)


def done(writes: LastWrites, pdu: str, client: str, at: float) -> None:
    writes.done(Request(200, bytes.fromhex(pdu), Client(client), at))  # type: ignore[arg-type]


def told(writes: LastWrites) -> list[tuple[str, str, float]]:
    return [(f"{each.span.area} {each.span.addresses}", each.client, each.at) for each in writes]


def test_the_newest_is_told_first_and_replaces_the_one_before():
    writes = LastWrites()
    done(writes, "06 00 00 00 01", "one", 1.0)
    done(writes, "10 00 00 00 02 04 00 01 00 02", "two", 2.0)
    done(writes, "06 00 00 00 01", "three", 3.0)
    assert told(writes) == [("holding 0", "three", 3.0), ("holding 0-1", "two", 2.0)]


def test_reads_and_what_writes_no_items_are_not_kept():
    writes = LastWrites()
    for pdu in ("03 00 00 00 01", "08 00 0A 00 00", "2B 0E 01 00"):
        done(writes, pdu, "one", 1.0)
    assert told(writes) == []


def test_every_function_that_writes_counts():
    writes = LastWrites()
    for pdu in (
        "05 00 00 FF 00",
        "0F 00 01 00 01 01 01",
        "16 00 02 00 00 00 00",
        "17 00 00 00 01 00 03 00 01 02 00 01",
    ):
        done(writes, pdu, "one", 1.0)
    assert [place for place, *_ in told(writes)] == ["holding 3", "holding 2", "coils 1", "coils 0"]


def test_the_oldest_makes_room():
    writes = LastWrites()
    for address in range(MOST + 3):
        done(writes, f"06 {address:04x} 00 01", "one", float(address))
    kept = told(writes)
    assert (len(kept), kept[-1][0]) == (MOST, "holding 3")
