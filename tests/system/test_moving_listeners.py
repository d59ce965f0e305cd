"""Listeners that go to another address on their port: the new one takes the place of the old, or nothing changes."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from gateway.errors import ListenError
from gateway.listeners.settings import ListenSettings
from gateway.listeners.sockets import OpenSockets, bind_sockets, find_addresses
from kit.free_port import free_port
from kit.ipv6 import needs_ipv6
from kit.process import PATIENCE, GatewayProcess, command

TCP, UDP = socket.SOCK_STREAM, socket.SOCK_DGRAM
ASK = bytes.fromhex("0001 0000 0006 C8 03 0000 0001")
ANSWER = bytes.fromhex("0001 0000 0005 C8 03 02 0000")
#: Requests without their transaction identifiers, which a server repeats as its responses.
WRITE = bytes.fromhex("0000 0006 C8 06 0000 0007")
OTHER_WRITE = bytes.fromhex("0000 0006 C9 06 0000 0007")


MOVES = [
    ("127.0.0.1", "0.0.0.0"),
    ("0.0.0.0", "127.0.0.1"),
    pytest.param("127.0.0.1", "::", marks=needs_ipv6),
    pytest.param("::", "127.0.0.1", marks=needs_ipv6),
    pytest.param("0.0.0.0", "::", marks=needs_ipv6),
]


@pytest.fixture
def port() -> int:
    """One that is free for TCP and for UDP."""
    return free_port()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


class Street:
    """Doors of one kind on one port."""

    def __init__(self, stack: ExitStack, kind: socket.SocketKind, port: int) -> None:
        self._stack = stack
        self.kind = kind
        self._port = port

    async def bound(self, host: str, ready: OpenSockets | None = None) -> socket.socket:
        settings = ListenSettings("scada", host, self._port, scheme="udp" if self.kind == UDP else "tcp")
        (door,) = bind_sockets(settings, await find_addresses(settings, self.kind), ready)
        return self._stack.enter_context(door)

    async def open(self, host: str, ready: OpenSockets | None = None) -> socket.socket:
        door = await self.bound(host, ready)
        if self.kind == TCP:
            door.listen()
        return door

    def leads_to(self, door: socket.socket) -> bool:
        """Whether who comes to 127.0.0.1 comes to this door."""
        door.settimeout(PATIENCE)
        with socket.socket(type=self.kind) as client:
            client.settimeout(PATIENCE)
            client.connect(("127.0.0.1", self._port))
            if self.kind == TCP:
                with door.accept()[0] as taken:
                    return taken.getpeername()[1] == client.getsockname()[1]
            client.send(b"?")
            return door.recvfrom(1)[1][1] == client.getsockname()[1]

    def has_room_for_another(self, host: str) -> bool:
        """Whether another program could take from what comes to the port."""
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, self.kind) as other:
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                other.bind((host, self._port))
            except OSError:
                return False
            return True


@pytest.fixture(params=[TCP, UDP], ids=["tcp", "udp"])
def street(request, stack: ExitStack, port: int) -> Street:
    return Street(stack, request.param, port)


@pytest.mark.parametrize(("old", "new"), MOVES)
async def test_a_new_door_takes_the_place_of_one_that_leaves(street: Street, old: str, new: str) -> None:
    leaving = await street.open(old)
    come = await street.open(new, OpenSockets(leaving=[leaving]))
    leaving.close()
    assert street.leads_to(come)
    assert not street.has_room_for_another(new)


@pytest.mark.parametrize(("old", "new"), MOVES)
async def test_a_door_that_stays_after_all_is_as_it_was(street: Street, old: str, new: str) -> None:
    stays = await street.open(old)
    sockets = OpenSockets(leaving=[stays])
    (await street.bound(new, sockets)).close()
    sockets.put_back()
    assert street.leads_to(stays)
    assert not street.has_room_for_another(old)


async def test_only_one_can_take_the_place(street: Street) -> None:
    sockets = OpenSockets(leaving=[await street.open("127.0.0.1")])
    await street.open("0.0.0.0", sockets)
    with pytest.raises((ListenError, OSError)):
        await street.open("0.0.0.0", sockets)


async def test_a_door_of_systemd_gives_way_to_nobody(street: Street, port: int) -> None:
    door = await street.open("127.0.0.1")
    with door.dup() as ours, pytest.raises(ListenError, match=rf"://127\.0\.0\.1:{port} has this port, by modbus-gate"):
        await street.open("0.0.0.0", OpenSockets([door], leaving=[ours]))
    assert street.leads_to(door)


@needs_ipv6
async def test_systemd_settles_whether_a_door_of_its_own_takes_ipv4(street: Street, port: int) -> None:
    with socket.socket(socket.AF_INET6, street.kind) as door:
        door.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        door.bind(("::", port))
        assert (await street.bound("::", OpenSockets([door]))).getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)


def config(*binds: str, unit: int = 200) -> str:
    listeners = "".join(f'[[listen]]\nname = "{number}"\nbind = "{bind}"\n' for number, bind in enumerate(binds))
    return f"{listeners}[[image]]\nunit = {unit}\nholding = 10\n"


class Moving:
    """A gateway whose listeners go to other addresses."""

    def __init__(self, stack: ExitStack, folder: Path, text: str) -> None:
        self._control = folder / "control.sock"
        self.gateway = stack.enter_context(GatewayProcess(folder, f'{text}[control]\nsocket = "{self._control}"\n'))
        self._rest = self.gateway.config.read_text().removeprefix(text)

    def reload(self, text: str) -> str:
        """What the command says."""
        self.gateway.config.write_text(text + self._rest)
        return command("reload", "--control", str(self._control)).stdout


def answer(port: int, kind: socket.SocketKind, host: str = "127.0.0.1") -> bytes:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, kind) as client:
        client.settimeout(PATIENCE)
        client.connect((host, port))
        client.send(ASK)
        return client.recv(260)


@pytest.mark.parametrize(("scheme", "kind"), [("tcp", TCP), ("udp", UDP)])
def test_a_reload_moves_a_listener_to_every_address_and_back(
    tmp_path: Path, stack: ExitStack, port: int, scheme: str, kind: socket.SocketKind
) -> None:
    here, everywhere = config(f"{scheme}://127.0.0.1:{port}"), config(f"{scheme}://0.0.0.0:{port}")
    moving = Moving(stack, tmp_path, here)
    for place in (everywhere, here):
        assert moving.reload(place).splitlines()[0] == "changed: listen 0"
        assert answer(port, kind) == ANSWER
    assert moving.gateway.stop() == 0
    assert not [event for event in moving.gateway.log if event["event"] == "client_rejected"]


@pytest.mark.parametrize(("old", "new"), [("127.0.0.1", "0.0.0.0"), ("0.0.0.0", "127.0.0.1")])
def test_after_a_reload_no_datagram_is_answered_with_what_was_asked_before_it(
    tmp_path: Path, stack: ExitStack, port: int, old: str, new: str
) -> None:
    server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
    server.settimeout(PATIENCE)
    before, after = (
        f"""
        [[listen]]
        name = "field"
        bind = "udp://{host}:{port}"
        [[access]]
        from = ["127.0.0.1"]
        listen = ["field"]
        allow = ["read", "write"]
        [[upstream]]
        to = "tcp://127.0.0.1:{server.getsockname()[1]}"
        timeout = "60 s"
        units = [{{ unit = "200-201", as = "200-201" }}]
        """
        for host in (old, new)
    )
    moving = Moving(stack, tmp_path, before)
    client = stack.enter_context(socket.socket(type=UDP))
    client.settimeout(PATIENCE)
    client.connect(("127.0.0.1", port))
    client.send(bytes(2) + WRITE)
    unit = stack.enter_context(server.accept()[0])
    unit.settimeout(PATIENCE)
    first = unit.recv(12, socket.MSG_WAITALL)
    assert moving.reload(after).startswith("changed: listen field")
    moving.gateway.wait_for("config_applied")
    told = [event["event"] for event in moving.gateway.log if event["event"] in {"client_closed", "listener_up"}]
    assert told[-2:] == ["client_closed", "listener_up"]  # nobody hears a client without knowing what it waits for
    client.send(bytes(2) + OTHER_WRITE)
    second = unit.recv(12, socket.MSG_WAITALL)
    assert [request[2:] for request in (first, second)] == [WRITE, OTHER_WRITE]
    unit.sendall(first + second)
    assert client.recv(260) == bytes(2) + OTHER_WRITE
    client.send(bytes(2) + WRITE)
    third = unit.recv(12, socket.MSG_WAITALL)
    unit.sendall(third)
    assert client.recv(260) == bytes(2) + WRITE


@needs_ipv6
@pytest.mark.parametrize(("scheme", "kind"), [("tcp", TCP), ("udp", UDP)])
def test_a_listener_of_ipv6_takes_ipv4_as_well_for_as_long_as_that_has_none_of_its_own(
    tmp_path: Path, stack: ExitStack, port: int, scheme: str, kind: socket.SocketKind
) -> None:
    one, both = config(f"{scheme}://[::]:{port}"), config(f"{scheme}://[::]:{port}", f"{scheme}://0.0.0.0:{port}")
    moving = Moving(stack, tmp_path, both)
    for place, said in ((one, "gone: listen 1"), (both, "new: listen 1"), (one, "gone: listen 1")):
        assert moving.reload(place).splitlines()[:2] == [said, "changed: listen 0"]
        for host in ("127.0.0.1", "::1"):
            assert answer(port, kind, host) == ANSWER
    assert moving.gateway.stop() == 0


@pytest.mark.parametrize(("scheme", "kind"), [("tcp", TCP), ("udp", UDP)])
def test_a_listener_stays_when_another_one_cannot_come(
    tmp_path: Path, stack: ExitStack, port: int, scheme: str, kind: socket.SocketKind
) -> None:
    moving = Moving(stack, tmp_path, config(f"{scheme}://127.0.0.1:{port}"))
    said = moving.reload(config(f"{scheme}://0.0.0.0:{port}", "tcp://192.0.2.1:5020"))
    assert "this machine has no such address" in said
    assert answer(port, kind) == ANSWER


def test_two_names_of_one_address_are_rejected_before_anything_changes(
    tmp_path: Path, stack: ExitStack, port: int
) -> None:
    stays = free_port()
    moving = Moving(stack, tmp_path, config(f"tcp://127.0.0.1:{stays}"))
    # a name that only the system knows for what it is
    three = (f"tcp://127.0.0.1:{stays}", f"tcp://0x7f000001:{port}", f"tcp://127.0.0.1:{port}")
    assert f"cannot listen on tcp://127.0.0.1:{port}: another [[listen]]" in moving.reload(config(*three, unit=201))
    assert answer(stays, TCP) == ANSWER
    assert moving.reload(config(f"tcp://127.0.0.1:{stays}")).startswith("nothing has changed in ")
