"""Rights by address: the code against a second evaluation, address by address, and against the words of `check`."""

from collections import Counter
from dataclasses import replace
from random import Random

import pytest

from gateway.cli.show.listeners import rights_as_text
from gateway.config.load import parse
from gateway.config.plan.access import access_row
from gateway.config.resolve import resolve
from gateway.config.schema.access import Access
from gateway.events import AccessDenied, WriteAudit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.request import Caller
from gateway.routing import access
from gateway.routing.access import AS_NUMBERED, NOTHING, READING, AccessRow, EntryPoint
from gateway.routing.broadcast import Broadcast, Recipient
from gateway.routing.deciding import Deciding
from gateway.routing.rights import Rights
from gateway.routing.router import CertifiedRouter, Router
from kit.asker import Asker
from kit.rights_reference import (
    EVERY_UNIT,
    HOSTS,
    LISTENERS,
    ROLES,
    UNITS,
    Row,
    any_request,
    is_allowed,
    only_reads,
    read_back,
)
from kit.router import router
from kit.target import CallingTarget

CONFIG = """
[[listen]]
name = "scada"
bind = "tcp://0.0.0.0:1502"
[[listen]]
name = "field"
bind = "udp://0.0.0.0:1502"
[[listen]]
name = "far"
bind = "tls://0.0.0.0"
certificate = "/x"
key = "/x"
clients_ca = "/x"
[[image]]
unit = 7
holding = 10
"""
KINDS = {"scada": "connection", "field": "datagram", "far": "certified"}


class CertifiedAsker(Asker):
    """One with a role."""

    def __init__(self, host, role):
        super().__init__(host=host)
        self.caller = Caller(f"{host}:1", host, host, "subject" if role else "", role)


EVERYTHING = Row(None, None, None, None, None, frozenset({"read", "write"}), None)
FAR = replace(EVERYTHING, listeners=("far", "field"))
NOWHERE = CallingTarget(lambda request, now: request.respond(request.pdu))


def random_table(chance):
    """Rows at random, and the plan that `check` makes of them."""
    rows = [Row.at_random(chance) for _ in range(chance.randint(1, 5))]
    if chance.random() < 0.8:
        rows.append(chance.choice((EVERYTHING, FAR, replace(EVERYTHING, allow=frozenset({"read"})))))
    loaded = parse(
        CONFIG + "".join(row.as_toml() for row in rows), "gateway.toml", port_trouble=lambda _: None, real_path=str
    )
    assert loaded.config is not None, loaded.errors
    return rows, resolve(loaded.config)


def decide(rows, listener, host, role, unit, pdu, known_as=AS_NUMBERED):
    """What the rows say, without the code that is tested."""
    if unit == 0:
        units = {each for each in range(1, 256) if each in EVERY_UNIT or known_as[each]}
        meant = [each for each in units if each in UNITS or known_as[each] != (each,)] + [8]  # the others are as 8
        return all(decide(rows, listener, host, role, each, pdu, known_as) for each in meant)
    here = [row for row in rows if row.fits_client(host, listener, role)]
    return all(
        is_allowed([row for row in here if row.fits_unit(unit, other)], pdu, only_reading=listener == "field")
        for other in known_as[unit] or (None,)
    )


def compared(seed, requests_of_each):
    """Compare all functions through a listener, and return how many requests were allowed, and how many were not."""
    chance = Random(seed)
    rows, plan = random_table(chance)
    words = rights_as_text(plan)
    said = read_back(words)
    listener = chance.choice(LISTENERS)
    role = chance.choice(ROLES) if listener == "far" else None
    known_as = list(AS_NUMBERED)
    if chance.random() < 0.3:
        known_as[42], known_as[3], known_as[250] = (3, 7), (), (1,)
    entry, events = EntryPoint(listener, KINDS[listener]), []
    router = (Router if role is None else CertifiedRouter)(entry, lambda: 0.0, events.append)
    router.routes = dict.fromkeys(range(256), NOWHERE)
    router.rights = Rights(plan.access, entry, tuple(known_as))
    is_unnamed = listener == "field" and not any(listener in (row.listeners or ()) for row in rows)
    told = Counter()
    for function in (*range(1, 128), *3 * (*range(1, 9), 15, 16, 22, 23, 43)):
        for _ in range(requests_of_each):
            host, unit, pdu = chance.choice(HOSTS), chance.choice((*UNITS, 250, 0)), any_request(chance, function)
            events.clear()
            client = CertifiedAsker(host, role or "")
            router.submit(client.ask(pdu.hex(), unit=unit), 0.0)
            expected = decide(rows, listener, host, role, unit, pdu, known_as)
            what = f"{listener} {host} {role} unit {unit} {pdu.hex(' ')} {known_as[unit]}\n{words}"
            assert client.answers == ([pdu.hex(" ").upper()] if expected else [f"{function | 0x80:02X} 01"]), what
            assert [type(each) for each in events] == [AccessDenied] * (not expected) + [WriteAudit] * (
                not only_reads(pdu)
            ), what
            if listener != "field" or is_unnamed:
                assert decide(said, listener, host, role, unit, pdu, known_as) == expected, what
            rights = router.rights if role is None else router.rights.of_role(role)
            assert rights.permits(host, unit, pdu) == expected, what
            told[expected] += 1
    return told


@pytest.mark.parametrize("seed", range(30))
def test_a_request_is_allowed_exactly_if_the_rows_say_so_address_by_address(seed):
    compared(seed, 2)


def test_the_comparison_sees_both():
    told = sum((compared(seed, 1) for seed in range(20)), Counter())
    assert min(told[True], told[False]) > 500


@pytest.mark.search
@pytest.mark.parametrize("seed", range(1000, 1080))
def test_many_tables_say_what_their_rows_say_address_by_address(seed):
    compared(seed, 5)


# What is told of a refusal, and who comes first


def rows_of(*rows):
    return tuple(map(access_row, (Access.model_validate(row) for row in rows)))


def asked_of(rows, pdu, *, unit=7, target=NOWHERE):
    """What a client is answered, and the events."""
    events, client = [], Asker()
    made = router({unit: target}, events.append, rows=rows)
    request = client.ask(pdu, unit=unit)
    made.submit(request, 0.0)
    return client.answers, [each for each in events if isinstance(each, AccessDenied)], request


KEEP_OUT = ({"holding": "0-99", "allow": ["read"]}, {"allow": ["read", "write"]})


@pytest.mark.parametrize(
    ("pdu", "refused_at"),
    [
        ("10 0062 0003 06 000000000000", "holding 98"),
        ("10 0063 0002 04 00000000", "holding 99"),
        ("06 0000 0001", "holding 0"),
        ("10 FFFF 0002 04 00000000", "holding 0"),  # a device may go on at 0
        ("17 0000 0001 0064 0001 02 0000", "holding 0"),  # 23 writes, so it is refused where it reads, too
        ("08 0000 1234", ""),
        ("10 0064 0000 00", ""),
        ("06 00", ""),
        ("41 00", ""),
    ],
)
def test_the_first_address_that_is_refused_is_told(pdu, refused_at):
    answers, denied, request = asked_of(rows_of(*KEEP_OUT), pdu)
    assert answers == [f"{int(pdu[:2], 16) | 0x80:02X} 01"]
    assert str(request.error) == ("through scada" + (f", at {refused_at}" if refused_at else ""))
    (event,) = denied
    assert event.refused_at == refused_at
    assert ("refused_at" in event.fields()) == bool(refused_at)
    assert event.in_words().endswith(f"unit 7 at {refused_at}" if refused_at else "unit 7")


@pytest.mark.parametrize("pdu", ["10 0064 0002 04 00000000", "03 0000 0064", "11", "05 0000 FF00", "06 FFFF 0001"])
def test_what_touches_no_such_address_passes(pdu):
    answers, denied, _ = asked_of(rows_of(*KEEP_OUT), pdu)
    assert (answers, denied) == ([bytes.fromhex(pdu).hex(" ").upper()], [])


@pytest.mark.parametrize(
    ("pdu", "has_priority"),
    [
        ("03 0000 0001", True),
        ("03 0005 0006", True),
        ("03 000A 0001", False),
        ("06 0000 0001", True),
        ("07", False),
        ("01 0000 0001", False),
    ],
)
def test_a_row_of_high_priority_gives_priority_to_the_requests_that_it_decides(pdu, has_priority):
    first = {"holding": "0-9", "allow": ["read", "write"], "priority": "high"}
    answers, _, request = asked_of(rows_of(first, {"allow": ["read", "write"]}), pdu)
    assert answers == [bytes.fromhex(pdu).hex(" ").upper()]
    assert request.caller.has_priority is has_priority
    assert replace(request.caller, has_priority=False) == request.origin.caller


def test_the_copies_of_a_broadcast_are_as_urgent_as_it_is():
    copies = []
    device = CallingTarget(lambda request, now: copies.append(request))
    rows = rows_of({"allow": ["read", "write"], "priority": "high"})
    asked_of(rows, "06 0000 0001", unit=0, target=Broadcast([Recipient(device)]))
    assert [each.caller.has_priority for each in copies] == [True]


def test_a_broadcast_is_refused_where_one_unit_is():
    rows = rows_of({"units": 9, "holding": "5", "allow": ["read"]}, {"allow": ["read", "write"]})
    for pdu, is_refused in (("06 0005 0001", True), ("06 0006 0001", False), ("10 0004 0002 04 00000000", True)):
        answers, denied, _ = asked_of(rows, pdu, unit=0)
        assert (len(denied), answers[0][3:] == "01") == (int(is_refused), is_refused), pdu
        assert not asked_of(rows, pdu)[1]


def test_what_a_client_may_do_by_addresses_only_admits_it():
    rows = rows_of({"from": ["10.2.0.0/24"], "holding": "5", "allow": ["read"]}, {"coils": "0", "functions": [3]})
    rights = Rights(rows, EntryPoint("scada"))
    assert [rights.admits(host) for host in ("10.2.0.7", "10.3.0.7")] == [True, False]
    assert [rights.names(host) for host in ("10.2.0.7", "10.3.0.7")] == [True, False]


def test_rows_for_addresses_leave_the_look_up_as_it_is_for_what_they_do_not_change():
    """So a plain read costs the router no more."""
    rows = rows_of({"holding": "0-99", "allow": ["read"]}, {"coils": "0", "allow": []}, {"allow": ["read", "write"]})
    right = Rights(rows, EntryPoint("scada"))["10.2.0.7"][7]
    assert right & READING == READING - {1}
    assert right - READING == NOTHING


def test_thousands_of_ranges_are_looked_up_and_not_searched():
    """A read of 2000 coils meets the rows that have some of these, and a request for one register one row."""
    rows = [AccessRow(READING, addresses=(Span(Area.COILS, 60 * at, 40),)) for at in range(1000)]
    deciding = Deciding([*rows, AccessRow(NOTHING)])
    assert len(list(deciding._deciders(Span(Area.COILS, 100, 2000)))) == 67
    assert len(list(deciding._deciders(Span(Area.COILS, 59, 1)))) == 1
    assert deciding.ruling(bytes.fromhex("01 0000 0028")).is_allowed
    assert deciding.ruling(bytes.fromhex("01 0000 07D0")).refused_at == "coils 40"


def test_what_is_allowed_at_every_address_at_some_and_by_which_rows():
    rows = rows_of({"units": 7, "holding": "0-99", "allow": ["read"]}, {"input": "5", "allow": []}, KEEP_OUT[1])
    rights = Rights(rows, EntryPoint("scada"))
    assert rights.everywhere("10.2.0.7", 7) == READING - {4}
    assert rights.somewhere("10.2.0.7", 7) == access.EVERYTHING
    assert rights.rows_for("10.2.0.7", 7) == rows
    assert rights.rows_for("10.2.0.7", 8) == rows[1:]
    assert not rights.reads_all("10.2.0.7")
    assert Rights((rows[0], rows[2]), EntryPoint("scada")).reads_all("10.2.0.7")
    alone = Rights(rows[:1], EntryPoint("scada"))
    assert (alone.everywhere("10.2.0.7", 7), alone.somewhere("10.2.0.7", 7)) == (NOTHING, frozenset({3}))
