"""Rights by address: the code against a second evaluation, address by address, and against the words of `check`."""

from collections import Counter
from dataclasses import replace
from random import Random
from types import SimpleNamespace

import pytest

from gateway.cli.show.rights import rights_as_text
from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.events import AccessDenied, WriteAudit
from gateway.request import Caller
from gateway.routing.access import AS_NUMBERED, EntryPoint
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
NOWHERE = SimpleNamespace(name="", submit=lambda request, now: request.respond(request.pdu))


def random_table(chance):
    """Rows at random, and the plan that `check` makes of them."""
    rows = [Row.at_random(chance) for _ in range(chance.randint(1, 5))]
    if chance.random() < 0.8:
        rows.append(chance.choice((EVERYTHING, FAR, replace(EVERYTHING, allow=frozenset({"read"})))))
    loaded = parse(CONFIG + "".join(row.as_toml() for row in rows), "gateway.toml", lambda _: None, str)
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
            told[expected] += 1
    return told


@pytest.mark.parametrize("seed", range(30))
def test_a_request_is_allowed_exactly_if_the_rows_say_so_address_by_address(seed):
    compared(seed, 2)


def test_the_comparison_sees_both():
    told = sum((compared(seed, 1) for seed in range(20)), Counter())
    assert min(told[True], told[False]) > 500


@pytest.mark.search
@pytest.mark.parametrize("seed", range(1000, 1400))
def test_many_tables_say_what_their_rows_say_address_by_address(seed):
    compared(seed, 5)
