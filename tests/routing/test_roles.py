"""Rights by the role in a client's certificate: rows, every function at units of each kind, and every unit."""

from ipaddress import ip_network

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.events import AccessDenied, Event, WriteAudit
from gateway.modbus.functions import only_reads
from gateway.request import Caller, NamedTarget, Origin, Request
from gateway.routing.access import DEFAULT_ROWS, EVERYTHING, NOTHING, READING, AccessRow, EntryPoint
from gateway.routing.rights import MOST_ROLES, Rights
from gateway.routing.router import CertifiedRouter
from kit.router import router

REMOTE = EntryPoint("remote", "certified")
SCADA = EntryPoint("scada")
UDP = EntryPoint("scada", "datagram")
CONTROL, HMI = EntryPoint("control", "local"), EntryPoint("hmi", "local")
ROLES = ["", "operator", "viewer", "stranger"]
HERE, ELSEWHERE = "127.0.0.1", "10.9.9.9"


class Reached(NamedTarget):
    """Each unit: it keeps what arrives."""

    def __init__(self) -> None:
        self.name = "bench"
        self.requests: list[Request] = []

    def submit(self, request: Request, now: float) -> None:
        self.requests.append(request)


class Bench(Origin):
    """A client with a certificate: what arrives at the units, what it is answered, and what is told of it."""

    def __init__(
        self, rows: tuple[AccessRow, ...], role: str, host: str = ELSEWHERE, entry: EntryPoint = REMOTE
    ) -> None:
        self.caller = Caller("10.9.9.9:1", host, host, "CN=somebody", role)
        self.unit = Reached()
        self.reached = self.unit.requests
        self.answers: list[bytes | None] = []
        self.events: list[Event] = []
        routes = dict.fromkeys(range(256), self.unit)
        self.router = router(routes, self.events.append, rows=rows, entry=entry, kind=CertifiedRouter)

    def asks(self, unit: int, pdu: bytes) -> bool:
        """Whether a request reaches its unit; the answer is 01 otherwise."""
        before = len(self.reached)
        self.router.submit(Request(unit, pdu, self, 0.0), 0.0)
        if len(self.reached) > before:
            return True
        assert self.answers[-1] == bytes((pdu[0] | 0x80, 1))
        return False

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answers.append(pdu)


def pdus() -> list[bytes]:
    """Each function with some content, and 43 with each kind of content that is told apart."""
    return [*(bytes((function, 0, 0, 0, 1)) for function in range(1, 128)), b"\x2b\x0e\x01\x00", b"\x2b\x0d\x00"]


#: Units at which each function is tried; elsewhere a read and each function that writes to a table.
FULLY_TRIED = {1, 39, 40, 41, 49, 50, 247}


def tried(unit: int) -> list[bytes]:
    return pdus() if unit in FULLY_TRIED else [bytes((function, 0, 0, 0, 1)) for function in (3, 5, 6, 15, 16, 22, 23)]


#: A viewer reads, an operator writes to some units and reads the others.
TABLE = (
    AccessRow(READING, role="viewer"),
    AccessRow(EVERYTHING, units=frozenset(range(40, 50)), role="operator"),
    AccessRow(READING, role="operator"),
)
OTHERS = (
    AccessRow(EVERYTHING, listeners=frozenset(["scada"])),
    AccessRow(EVERYTHING, networks=(ip_network("10.0.0.0/8"),)),
)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize(
    ("rows", "readers", "writers"),
    [
        (TABLE, ["viewer", "operator"], ["operator"]),
        (DEFAULT_ROWS, ROLES, []),
        (OTHERS, [], []),
    ],
    ids=["rows for roles", "no rows", "rows for others only"],
)
def test_only_a_role_that_may_write_gets_a_write_to_a_unit(
    rows: tuple[AccessRow, ...], readers: list[str], writers: list[str], role: str
) -> None:
    bench = Bench(rows, role)
    for unit in range(1, 248):
        for pdu in tried(unit):
            may_read, may_write = role in readers, role in writers and 40 <= unit < 50
            assert bench.asks(unit, pdu) is (may_write or (may_read and only_reads(pdu)))
    assert all(only_reads(each.pdu) or (role in writers and 40 <= each.unit < 50) for each in bench.reached)


@given(
    rows=st.lists(
        st.builds(
            AccessRow,
            right=st.sampled_from([NOTHING, READING, EVERYTHING]),
            networks=st.sampled_from([None, (ip_network("127.0.0.0/8"),), (ip_network("10.0.0.0/8"),)]),
            listeners=st.sampled_from([None, frozenset(["remote"]), frozenset(["scada"]), frozenset(["control"])]),
            units=st.sampled_from([None, frozenset([7]), frozenset(range(1, 248))]),
            role=st.sampled_from([None, *ROLES]),
        ),
        max_size=5,
    ).map(lambda rows: tuple(rows) or DEFAULT_ROWS),  # as in a config: an empty table is the default one
    role=st.sampled_from(ROLES),
    host=st.sampled_from([HERE, ELSEWHERE]),
    unit=st.sampled_from([1, 7, 247]),
)
def test_the_first_row_that_fits_counts_and_nothing_else(
    rows: tuple[AccessRow, ...], role: str, host: str, unit: int
) -> None:
    def fits(row: AccessRow) -> bool:
        return (
            (row.role == role or (row.role is None and (row.listeners is not None or row.for_all)))
            and (row.listeners is None or "remote" in row.listeners)
            and (row.networks is None or host.partition(".")[0] == str(row.networks[0]).partition(".")[0])
            and (row.units is None or unit in row.units)
        )

    expected = next((row.right for row in rows if fits(row)), NOTHING)
    rights = Rights(rows, REMOTE)
    assert rights.of_role(role)[host][unit] == expected
    assert not expected or rights.admits(host)
    without_roles = [row for row in rows if row.role is None]
    for entry, other in ((SCADA, host), (UDP, host), (CONTROL, ""), (HMI, "")):
        assert Rights(rows, entry)[other][unit] == Rights(without_roles, entry)[other][unit]


@pytest.mark.parametrize("host", [HERE, ELSEWHERE])
@pytest.mark.parametrize("role", ROLES)
def test_without_a_table_clients_with_certificates_only_read(host: str, role: str) -> None:
    rights = Rights(DEFAULT_ROWS, REMOTE)
    assert set(rights.of_role(role)[host]) == {READING}
    assert rights.admits(host)


def test_a_row_for_a_network_gives_a_certified_client_nothing() -> None:
    rows = (AccessRow(EVERYTHING, networks=(ip_network("10.0.0.0/8"),)),)
    assert set(Rights(rows, REMOTE).of_role("operator")[ELSEWHERE]) == {NOTHING}
    assert not Rights(rows, REMOTE).admits(ELSEWHERE)
    assert set(Rights(rows, SCADA)[ELSEWHERE]) == {EVERYTHING}


def test_a_role_that_may_do_nothing_keeps_no_other_role_out() -> None:
    rights = Rights((AccessRow(NOTHING, role="visitor"), AccessRow(EVERYTHING, role="operator")), REMOTE)
    assert rights.admits(ELSEWHERE)
    network = (ip_network("10.0.0.0/8"),)
    rights = Rights(
        (AccessRow(NOTHING, role="visitor"), AccessRow(EVERYTHING, networks=network, role="operator")), REMOTE
    )
    assert (rights.admits(ELSEWHERE), rights.names(ELSEWHERE)) == (True, True)
    assert not rights.admits(HERE)


@pytest.mark.parametrize("name", ["control", "hmi"])
def test_a_row_for_a_role_takes_nothing_from_clients_without_an_address(name: str) -> None:
    """Nobody shows a certificate there."""
    row = AccessRow(READING, listeners=frozenset([name]), role="operator")
    assert set(Rights((row,), EntryPoint(name, "local"))[""]) == {EVERYTHING}


def test_the_rights_of_any_number_of_roles_take_bounded_memory() -> None:
    rights = Rights((AccessRow(EVERYTHING, role="role-1"),), REMOTE)
    for number in range(3 * MOST_ROLES):
        assert set(rights.of_role(f"role-{number}")[HERE]) == {EVERYTHING if number == 1 else NOTHING}
    assert len(rights._roles) <= MOST_ROLES


def test_subject_and_role_stand_in_the_account() -> None:
    bench = Bench((AccessRow(READING, role="viewer"),), "viewer")
    assert not bench.asks(7, b"\x06\0\0\0\1")
    denied, audited = bench.events
    assert isinstance(denied, AccessDenied)
    assert isinstance(audited, WriteAudit)
    for event in (denied, audited):
        assert (event.fields()["subject"], event.fields()["role"]) == ("CN=somebody", "viewer")
    assert "subject" not in AccessDenied("scada", "10.0.0.1:1", 7, 6).fields()
