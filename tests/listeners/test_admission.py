"""Who is let in, and who makes room for another client."""

from dataclasses import dataclass, field
from ipaddress import ip_network

import pytest

from gateway.listeners.admission import ALL_BUSY, NO_RIGHTS, NONE_REPLACEABLE, PROTECTED, Admission
from gateway.listeners.settings import ListenSettings
from gateway.request import Caller
from gateway.routing.access import DEFAULT_ROWS, READING, AccessRow, EntryPoint
from gateway.routing.rights import Rights
from gateway.timing.measured import NEVER

EVERYBODY = Rights(DEFAULT_ROWS, EntryPoint("scada"))
#: The control room is named.
NAMED_ROWS = (AccessRow(READING, networks=(ip_network("10.0.0.0/24"),)), AccessRow(READING))
NAMED = Rights(NAMED_ROWS, EntryPoint("scada"))
LOOK = 0.25


@dataclass(eq=False)
class Client:
    caller: Caller
    last_asked: float = NEVER
    is_idle: bool = True
    role: str | None = None


@dataclass
class Lobby:
    """A room with a clock. Hosts are one letter, or an address; `closed` are those who made room, in turn."""

    places: int = 4
    reserve: int = 0
    rights: Rights = field(default_factory=lambda: EVERYBODY)
    now: float = 1000.0
    closed: list[Client] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.room: Admission[Client] = Admission()

    def comes(self, host: str, *, asks: bool = False, role: str | None = None) -> Client | str:
        """A client connects, and asks at once or does not; or the reason why it is not let in."""
        host = f"192.0.2.{ord(host)}" if len(host) == 1 else host
        settings = ListenSettings("scada", "::", 502, clients=self.places, reserve=self.reserve)
        caller = Caller(f"{host}:1", host, host)
        refusal = self.room.make_room(caller, self.rights, settings, self.now, self._close_replaced, role)
        if refusal:
            return refusal
        client = Client(caller, role=role)
        self.room.enter(client, self.now)
        assert len(self.room) <= self.places
        if asks:
            client.last_asked = self.now
        return client

    def polls(self, client: Client, times: int, every: float) -> None:
        for _ in range(times):
            client.last_asked = self.now
            self.passes(every)

    def passes(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now + LOOK <= end:
            self.now += LOOK
            self.room.look(self.now)
        self.now = end

    def leaves(self, client: Client) -> None:
        self.room.leave(client)

    def makes_room(self, host: str) -> Client:
        """Who makes room for a client from this host."""
        count = len(self.closed)
        assert isinstance(self.comes(host), Client)
        assert len(self.closed) == count + 1
        return self.closed[-1]

    def _close_replaced(self, client: Client) -> None:
        self.closed.append(client)
        self.room.leave(client)


@pytest.fixture
def lobby() -> Lobby:
    return Lobby()


def test_as_long_as_there_is_a_place_nobody_makes_room(lobby: Lobby) -> None:
    for host in "AABC":
        assert isinstance(lobby.comes(host), Client)
    assert lobby.closed == []


def test_nobody_makes_room_for_a_client_without_rights(lobby: Lobby) -> None:
    lobby.rights = Rights((), EntryPoint("scada"))
    assert lobby.comes("A") == NO_RIGHTS


# --- the order ---


def test_first_goes_who_is_of_the_address_with_most_connections(lobby: Lobby) -> None:
    lobby.comes("B")
    first, second = lobby.comes("A", asks=True), lobby.comes("A", asks=True)
    lobby.comes("C")
    lobby.passes(1)
    second.last_asked = lobby.now
    assert lobby.makes_room("D") is first


def test_then_who_was_never_served(lobby: Lobby) -> None:
    lobby.comes("A", asks=True)
    lobby.passes(60)
    silent = lobby.comes("B")
    for host in "CD":
        lobby.comes(host, asks=True)
    assert lobby.makes_room("E") is silent


def test_then_who_is_idle_for_longest(lobby: Lobby) -> None:
    clients = []
    for host in "ABCD":
        clients.append(lobby.comes(host, asks=True))
        lobby.passes(0.1)
    for client in (clients[0], clients[2], clients[3]):
        lobby.passes(0.01)
        client.last_asked = lobby.now
    lobby.passes(PROTECTED)
    assert lobby.makes_room("E") is clients[1]
    assert lobby.makes_room("F").caller.host == "192.0.2.69"  # E has not asked
    lobby.leaves(lobby.comes("F"))
    lobby.leaves(Client("G"))  # never came


def test_nobody_goes_who_has_a_request_under_way(lobby: Lobby) -> None:
    busy = [lobby.comes(host) for host in "AAA"]
    for client in busy:
        client.is_idle = False
    idle = lobby.comes("B")
    assert lobby.makes_room("C") is idle


def test_when_all_have_requests_under_way_the_one_who_comes_is_sent_away(lobby: Lobby) -> None:
    for host in "ABCD":
        lobby.comes(host).is_idle = False
    assert lobby.comes("E") == ALL_BUSY


# --- who stays ---


def test_who_was_served_a_moment_ago_stays_and_the_one_who_comes_is_sent_away(lobby: Lobby) -> None:
    clients = [lobby.comes(host, asks=True) for host in "ABCD"]
    lobby.passes(PROTECTED - LOOK)
    assert lobby.comes("E") == NONE_REPLACEABLE
    lobby.passes(LOOK)
    assert lobby.makes_room("E") in clients


def test_who_was_served_makes_room_for_another_connection_of_its_address() -> None:
    """As of a device that has lost its connections without a word, or a UDP client with a new port each time."""
    lobby = Lobby(places=2)
    first, second = (lobby.comes("A", asks=True) for _ in range(2))
    lobby.passes(0.1)
    first.last_asked = lobby.now
    assert lobby.makes_room("A") is second


def test_who_was_served_gives_up_what_its_address_has_beyond_others(lobby: Lobby) -> None:
    clients = [lobby.comes(host) for host in "AABC"]
    for client in clients:
        lobby.polls(client, 3, every=1)
    assert lobby.makes_room("D").caller.host == clients[0].caller.host


def test_addresses_with_equally_many_make_room_for_one_that_has_none(lobby: Lobby) -> None:
    clients = [lobby.comes(host) for host in "AABB"]
    for _ in range(3):
        for client in clients:
            client.last_asked = lobby.now
        lobby.passes(1)
    assert lobby.makes_room("C") in clients


def test_whoever_floods_a_listener_only_drives_out_itself(lobby: Lobby) -> None:
    other = lobby.comes("B")
    for _ in range(10):
        lobby.comes("A")
    assert other not in lobby.closed
    for client in lobby.room:
        client.is_idle = client is other
    assert lobby.comes("A") == NONE_REPLACEABLE
    assert len(lobby.closed) == 7


def test_who_waited_long_for_an_answer_was_served_when_it_came(lobby: Lobby) -> None:
    client = lobby.comes("A", asks=True)
    client.is_idle = False
    lobby.passes(2 * PROTECTED)
    client.is_idle = True
    others = [lobby.comes(host, asks=True) for host in "BCD"]
    lobby.passes(PROTECTED - LOOK)
    assert lobby.comes("E") == NONE_REPLACEABLE
    lobby.passes(LOOK)
    assert lobby.makes_room("E") is client
    assert lobby.makes_room("F").caller.host == "192.0.2.69"
    assert all(other in lobby.room for other in others)


# --- places that are kept ---


def test_unknown_clients_leave_the_reserve_to_those_whom_rows_name() -> None:
    lobby = Lobby(places=4, reserve=2, rights=NAMED)
    first = lobby.comes("A")
    lobby.comes("B")
    assert lobby.makes_room("C") is first
    for number in range(2):
        assert isinstance(lobby.comes(f"10.0.0.{number}"), Client)
    assert len(lobby.room) == 4
    assert {lobby.makes_room(host).caller.host[:3] for host in "DEFGH"} == {"192"}


def test_those_whom_rows_name_take_the_other_places_too_as_long_as_there_are_any() -> None:
    lobby = Lobby(places=3, reserve=1, rights=NAMED)
    for number in range(3):
        lobby.comes(f"10.0.0.{number}")
    assert lobby.makes_room("A").caller.host == "10.0.0.0"
    assert lobby.makes_room("10.0.0.9").caller.host == "10.0.0.1"


def test_a_role_that_no_row_names_for_its_address_gets_no_reserved_place() -> None:
    row = AccessRow(READING, networks=(ip_network("10.0.0.0/24"),), role="operator")
    rights = Rights((row, AccessRow(READING, role="viewer")), EntryPoint("remote", "certified"))
    lobby = Lobby(places=3, reserve=2, rights=rights)
    first = lobby.comes("10.0.0.1", role="viewer")
    assert isinstance(first, Client)
    assert isinstance(lobby.comes("10.0.0.2", role="viewer"), Client)  # in place of the first
    assert lobby.closed == [first]
    for host in ("10.0.0.3", "10.0.0.4"):
        assert isinstance(lobby.comes(host, role="operator"), Client)
    assert lobby.closed == [first]
    assert isinstance(lobby.comes("10.0.0.5", role="viewer"), Client)
    assert [each.role for each in lobby.closed] == ["viewer", "viewer"]


def test_clients_are_not_looked_up_again_for_everybody_who_comes() -> None:
    """More than rights remember at a time."""
    found: list[str] = []

    class Told(Rights):
        def names(self, host: str, role: str | None = None) -> bool:
            found.append(host)
            return super().names(host, role)

    lobby = Lobby(places=2001, reserve=1, rights=Told(NAMED_ROWS, EntryPoint("scada")))
    for number in range(2000):
        lobby.comes(f"10.1.{number // 250}.{number % 250}")
    lobby.makes_room("A")
    found.clear()
    lobby.makes_room("B")
    assert len(found) <= 2


def test_new_rights_count_for_those_who_are_in() -> None:
    lobby = Lobby(places=4, reserve=2, rights=NAMED)
    for host in ("A", "B", "10.0.0.1"):
        lobby.comes(host)
    lobby.makes_room("C")
    lobby.rights = Rights(
        (AccessRow(READING, networks=(ip_network("192.0.2.0/24"),)), AccessRow(READING)), EntryPoint("scada")
    )
    assert isinstance(lobby.comes("10.0.0.2"), Client)
    assert lobby.makes_room("10.0.0.3").caller.host == "10.0.0.1"


# --- a crowd: promise P18 ---


@dataclass
class Source:
    """One of a crowd of addresses. It connects, asks, and does so again as soon as it is closed or sent away.

    It goes on `asking` at an interval; all the time when that is 0.0, not at all when it is None. Or it `leaves`. First
    it asks so `many` times at once.
    """

    host: str
    asking: float | None
    leaves: bool
    many: int = 1
    client: Client | None = None
    asked: int = 0

    def step(self, lobby: Lobby) -> None:
        """What it does in twenty milliseconds."""
        if self.client is None or self.client not in lobby.room:
            come = lobby.comes(self.host, asks=True)
            self.client = come if isinstance(come, Client) else None
            if self.client is not None:
                self.client.is_idle, self.asked = self.asking != 0.0, 1
        elif self.asked < self.many:
            self.client.last_asked = lobby.now
            self.asked += 1
        elif self.leaves:
            lobby.leaves(self.client)
        elif self.asking and lobby.now - self.client.last_asked >= self.asking:
            self.client.last_asked = lobby.now


CROWDS = {
    "asks once and stays": (None, False),
    "asks once and leaves": (None, True),
    "asks three times and stays": (None, False, 3),
    "asks at short intervals": (0.05, False),
    "asks once a second": (1.0, False),
    "asks without end": (0.0, False),
}


def failed_polls(kind: str, *, crowd_comes_at: int, ticks: int = 50) -> int:
    """How many polls of twelve seconds, one in so many ticks of 20 ms, find their connection closed, or get none.

    The crowd is half as large again as the room.
    """
    lobby = Lobby(places=10)
    crowd = [Source(f"192.0.2.{number}", *CROWDS[kind]) for number in range(16)]
    client: Client | None = None
    failed = 0
    for tick in range(50 * min(crowd_comes_at, 0), 12 * 50):
        if tick >= 0 and tick % ticks == 0:
            was_closed = client is not None and client not in lobby.room
            if client is None or was_closed:
                come = lobby.comes("10.0.0.1")
                client = come if isinstance(come, Client) else None
            failed += was_closed or client is None
            if client is not None:
                client.last_asked = lobby.now
        for source in crowd if tick >= 50 * crowd_comes_at else ():
            source.step(lobby)
        lobby.now += 0.02
        if tick % 12 == 0:
            lobby.room.look(lobby.now)
    return failed


@pytest.mark.search
@pytest.mark.parametrize("ticks", [5, 10, 15, 50])
@pytest.mark.parametrize("kind", CROWDS)
def test_a_crowd_of_addresses_that_come_and_go_never_close_a_client_that_asks_as_usual(kind: str, ticks: int) -> None:
    assert failed_polls(kind, crowd_comes_at=2, ticks=ticks) == 0


def test_a_client_that_comes_to_a_full_listener_is_let_in_when_one_was_idle_for_long(lobby: Lobby) -> None:
    for number in range(4):
        lobby.comes(f"192.0.2.{number}", asks=True)
    rejected = 0
    while isinstance(lobby.comes("10.0.0.1", asks=True), str):
        lobby.passes(1)
        rejected += 1
    assert rejected == PROTECTED


def test_many_who_ask_seldom_share_the_places_there_are(lobby: Lobby) -> None:
    """Each opens a connection when it has none: all seven are served at four places."""
    clients: dict[str, Client] = {}
    for _ in range(5):
        for host in "ABCDEFG":
            if clients.get(host) not in lobby.room:
                come = lobby.comes(host)
                assert isinstance(come, Client)
                clients[host] = come
            clients[host].last_asked = lobby.now
            lobby.passes(10)


@pytest.mark.search
def test_a_crowd_that_leaves_does_not_keep_a_client_out() -> None:
    assert failed_polls("asks once and leaves", crowd_comes_at=-2) <= 1
