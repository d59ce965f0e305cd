"""Device servers: a TCP connection as a port, and a whole gateway in front of ser2net, in real time."""

import asyncio
import select
import signal
import socket
import struct
import subprocess
import threading
import time
from contextlib import asynccontextmanager, closing, suppress
from pathlib import Path
from typing import Self

import pytest

from gateway.errors import PortError
from gateway.events import LineLost, LineReopened
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.ports import network
from gateway.ports import tcp as tcp_module
from gateway.ports.port import TcpSettings
from gateway.ports.reconnector import Reconnector
from gateway.ports.tcp import WRITE_BOUND, open_tcp
from kit.device import SimulatedDevice, SimulatedLine
from kit.free_port import free_port
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
ANSWER = bytes.fromhex("0001 0000 0005 01 03 02 0007")


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """For all tests but those of these deadlines, which set them."""
    monkeypatch.setattr(tcp_module, "LOOKUP_DEADLINE", PATIENCE)
    monkeypatch.setattr(tcp_module, "CONNECTING_DEADLINE", PATIENCE)


class User:
    """Notes what its port tells it."""

    def __init__(self):
        self.heard = b""
        self.losses = []

    def received(self, data):
        self.heard += data

    def lost(self, error):
        self.losses.append(str(error))


class Owner:
    """A line that only notes."""

    def __init__(self):
        self.port = None
        self.downs = 0

    def port_up(self, port):
        self.port = port

    def received(self, data):
        pass

    def port_ended(self, open_again, *, at_once):
        return False

    def port_down(self, error):
        self.port = None
        self.downs += 1


@pytest.fixture
def user():
    return User()


@pytest.fixture
def server():
    with socket.create_server(("127.0.0.1", free_port())) as server:
        server.setblocking(False)
        yield server


def settings(number, host="127.0.0.1", latency=0.05, **others):
    return TcpSettings(f"rtu+tcp://{host}:{number}", host, number, latency, **others)


def settings_of(server, **others):
    return settings(server.getsockname()[1], **others)


async def accepted(server):
    sock, _ = await asyncio.wait_for(asyncio.get_running_loop().sock_accept(server), PATIENCE)
    return sock


@asynccontextmanager
async def connected(server, user):
    """An open port, and the server's end of it."""
    port = await open_tcp(settings_of(server), user)
    with closing(await accepted(server)) as far_end:
        yield port, far_end
        port.close()
        await asyncio.wait_for(port.wait_closed(), PATIENCE)


async def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "not within the time"
        await asyncio.sleep(0.005)


async def why_not(settings, user):
    with pytest.raises(PortError) as raised:
        await open_tcp(settings, user)
    return str(raised.value)


def descriptors():
    return set(Path("/proc/self/fd").iterdir())


# --- connecting ---


async def test_bytes_go_both_ways(server, user):
    async with connected(server, user) as (port, far_end):
        port.write(b"ask")
        assert await asyncio.get_running_loop().sock_recv(far_end, 10) == b"ask"
        far_end.send(b"answer")
        await until(lambda: user.heard == b"answer")
        assert (port.is_virtual, port.latency) == (True, 0.05)
    assert user.losses == ["closed"]


@pytest.mark.parametrize(("drops", "expected"), [(False, b"late answernew"), (True, b"new")])
async def test_what_the_server_still_held_for_somebody_else_is_heard_before_anything_is_sent(server, drops, expected):
    """Or dropped. Again where a busy machine sent it when the time for it was over."""
    for _ in range(5):
        took, first, heard = await heard_behind_what_was_held(server, drops_early=drops)
        if took < tcp_module.LONGEST_SETTLING:
            break
    assert first + b"new" == heard == expected


async def heard_behind_what_was_held(server, *, drops_early):
    """How long it took to send what was held, in seconds, what was heard first, and what then."""
    user, began = User(), time.monotonic()
    sending = asyncio.create_task(accepted_and_told(server))
    port = await open_tcp(settings_of(server, latency=2.0, drops_early=drops_early), user)
    assert user.heard == b""
    port.read_now()  # as before anything is sent
    first = user.heard
    far_end, sent_at = await sending
    with closing(far_end):
        far_end.send(b"new")
        await until(lambda: user.heard.endswith(b"new"))
        port.close()
        await port.wait_closed()
    return sent_at - began, first, user.heard


async def accepted_and_told(server):
    """The server's end of a connection that it sends something on at once, and when that was."""
    far_end = await accepted(server)
    far_end.send(b"late answer")
    return far_end, time.monotonic()


async def test_it_sends_at_once_and_watches_the_peer(server, user):
    async with connected(server, user) as (port, _):
        sock = port._transport.get_extra_info("socket")
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        watched = [socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT]
        idle, interval, probes = (sock.getsockopt(socket.IPPROTO_TCP, option) for option in watched)
        assert idle + interval * probes <= 30
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) <= 30_000


async def test_nobody_there_is_said(user):
    number = free_port()
    assert await why_not(settings(number), user) == (
        f"rtu+tcp://127.0.0.1:{number} refuses the connection: does the server run, and is the port number right?"
    )


async def test_every_address_of_a_name_is_tried(server, user, monkeypatch):
    """The name leads to an address where nobody listens, and then to the server."""
    nobody, somebody = ("127.0.0.2", server.getsockname()[1]), server.getsockname()
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", where) for where in (nobody, somebody)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)
    port = await open_tcp(settings_of(server, host="nport.example"), user)
    port.close()
    await port.wait_closed()


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (socket.EAI_NONAME, "unknown host name nport.example"),
        (socket.EAI_AGAIN, "no name server answers, so nport.example cannot be found"),
        (socket.EAI_FAIL, "cannot be reached: the server is odd"),
    ],
)
async def test_a_name_that_leads_nowhere_is_said(user, monkeypatch, code, said):
    def fails(*_, **__):
        raise socket.gaierror(code, "the server is odd")

    monkeypatch.setattr(socket, "getaddrinfo", fails)
    assert said in await why_not(settings(502, "nport.example"), user)


async def test_a_resolver_that_hangs_holds_up_nobody(user, monkeypatch):
    release = threading.Event()
    monkeypatch.setattr(tcp_module, "LOOKUP_DEADLINE", 0.1)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: release.wait(PATIENCE) and [])
    for _ in range(3):
        assert "no name server answers" in await why_not(settings(502, "nport.example"), user)
    assert [thread.name for thread in threading.enumerate()].count("look up nport.example") == 1
    release.set()
    await until(lambda: not network._under_way)


async def test_a_server_that_does_not_answer_is_said(user, monkeypatch):
    monkeypatch.setattr(tcp_module, "CONNECTING_DEADLINE", 0.3)
    with socket.socket() as deaf, socket.socket() as one, socket.socket() as other:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen(0)
        for waiting in (one, other):  # its backlog is full then, and the system drops what comes
            waiting.setblocking(False)
            waiting.connect_ex(deaf.getsockname())
        assert "does not answer: is it on, and does every firewall let us through?" in await why_not(
            settings_of(deaf), user
        )


async def test_an_attempt_that_is_given_up_leaves_nothing_open(server, user, monkeypatch):
    monkeypatch.setattr(tcp_module, "LONGEST_SETTLING", PATIENCE)
    before = descriptors()
    opening = asyncio.create_task(open_tcp(settings_of(server, latency=PATIENCE), user))
    with closing(await accepted(server)) as far_end:
        opening.cancel()
        await asyncio.wait([opening])
        assert await asyncio.wait_for(asyncio.get_running_loop().sock_recv(far_end, 1), PATIENCE) == b""
    assert opening.cancelled()
    await until(lambda: descriptors() <= before)
    assert user.losses == []


async def test_a_server_that_serves_somebody_else_is_told_apart(server, user, monkeypatch):
    """ser2net says a line of text and closes; others just close."""
    monkeypatch.setattr(tcp_module, "LONGEST_SETTLING", PATIENCE)
    opening = asyncio.create_task(why_not(settings_of(server, latency=PATIENCE), user))
    with closing(await accepted(server)) as far_end:
        far_end.send(b"Port already in use\r\n")
    assert (await opening).endswith("takes the connection and closes it at once: is somebody else connected?")
    assert (user.heard, user.losses) == (b"", [])


async def test_after_connecting_there_is_silence_as_long_as_the_config_says(server, user):
    began = time.monotonic()
    opening = asyncio.create_task(open_tcp(settings_of(server, after_connect=0.7), user))
    with closing(await accepted(server)) as far_end:
        far_end.send(b"hello")
        port = await opening
        assert time.monotonic() - began >= 0.7
        await until(lambda: user.heard == b"hello")
        port.close()
        await port.wait_closed()


async def test_who_looks_hears_at_once_what_has_come(server, user):
    async with connected(server, user) as (port, far_end):
        port.read_now()
        assert (user.heard, user.losses) == (b"", [])
        far_end.send(b"answer")
        select.select([port._descriptor], [], [], PATIENCE)
        port.read_now()
        assert user.heard == b"answer"
        far_end.send(b" and more")
        await until(lambda: user.heard == b"answer and more")


async def test_it_knows_whether_what_was_written_has_arrived(user):
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # the system's least: some kilobytes
        server.bind(("127.0.0.1", 0))
        server.listen()
        server.setblocking(False)
        async with connected(server, user) as (port, far_end):
            assert port.has_arrived()
            port.write(b"ask")
            await until(port.has_arrived)
            port.write(bytes(WRITE_BOUND))
            await asyncio.sleep(0.1)
            assert not port.has_arrived()
            far_end.send(b"late answer")
            await until(lambda: user.heard)
            assert not port.has_arrived()
            missing = WRITE_BOUND + len(b"ask")
            while missing:
                missing -= len(await asyncio.get_running_loop().sock_recv(far_end, missing))
            await until(port.has_arrived)


# --- losing the connection ---


async def test_who_looks_at_an_ended_connection_learns_that_at_once_and_only_once(server, user):
    async with connected(server, user) as (port, far_end):
        far_end.send(b"answer")
        await until(lambda: user.heard)
        far_end.close()
        select.select([port._descriptor], [], [], PATIENCE)
        port.read_now()
        assert len(user.losses) == 1
        port.read_now()
        await asyncio.wait_for(port.wait_closed(), PATIENCE)
    assert [loss.partition(" ")[2] for loss in user.losses] == ["has closed the connection"]
    assert user.heard == b"answer"


@pytest.mark.parametrize("says", [b"answer", b""])
async def test_whether_a_server_closes_at_once_is_told(server, user, says):
    async with connected(server, user) as (_, far_end):
        far_end.send(says)
        await until(lambda: user.heard == says)
        far_end.close()
        await until(lambda: user.losses)
    (loss,) = user.losses
    assert ("closes it at once: is somebody else connected?" in loss) == (not says)


async def test_a_server_that_closes_after_a_while_does_not_do_so_at_once(server, user, monkeypatch):
    monkeypatch.setattr(tcp_module, "AT_ONCE", 0.0)
    async with connected(server, user) as (_, far_end):
        far_end.close()
        await until(lambda: user.losses)
    assert user.losses[0].endswith("has closed the connection")


async def test_a_reset_is_noticed_by_who_looks(server, user):
    async with connected(server, user) as (port, far_end):
        far_end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        far_end.close()
        select.select([port._descriptor], [], [], PATIENCE)
        port.read_now()
        await until(lambda: user.losses)
    assert [loss.partition(" ")[2] for loss in user.losses] == ["is gone: connection reset by peer"]


async def test_the_end_of_the_stream_is_a_loss(server, user):
    async with connected(server, user) as (port, far_end):
        far_end.close()
        await until(lambda: user.losses)
        port.write(b"to nobody")
    assert [loss.partition(" ")[2][:20] for loss in user.losses] == ["takes the connection"]


async def test_a_reset_is_a_loss(server, user):
    async with connected(server, user) as (_, far_end):
        far_end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        far_end.close()
        await until(lambda: user.losses)
    assert [loss.partition(" ")[2] for loss in user.losses] == ["is gone: connection reset by peer"]


async def test_a_server_that_takes_nothing_is_a_loss_before_much_is_kept(server, user):
    async with connected(server, user) as (port, _):
        for _ in range(10_000):
            port.write(bytes(4096))
            if user.losses or port._transport.is_closing():
                break
        assert port._transport.get_write_buffer_size() <= WRITE_BOUND + 4096
        await until(lambda: user.losses)
    assert [loss.partition(" ")[2] for loss in user.losses] == ["takes no more data"]


async def test_a_rate_that_cannot_be_set_from_here_is_a_loss_that_says_what_to_do(server, user):
    async with connected(server, user) as (port, _):
        port.change_baud(9600)
        await until(lambda: user.losses)
    assert user.losses[0].endswith("the device server keeps its rate; set it to 9600 baud there")


async def test_a_keeper_connects_again(user):
    number, owner, told = free_port(), Owner(), []
    reconnector = Reconnector("hall-a", "nport", lambda user: open_tcp(settings(number), user), owner, told.append)
    keeping = asyncio.create_task(reconnector.run())
    try:
        await reconnector.tried.wait()
        for _ in range(3):
            with socket.create_server(("127.0.0.1", number)) as server:
                server.setblocking(False)
                with closing(await accepted(server)):
                    await until(lambda: owner.port)
            await until(lambda: owner.port is None)
    finally:
        keeping.cancel()
        await asyncio.wait([keeping])
    assert owner.downs == 3
    assert sum(isinstance(event, LineReopened) for event in told) == 2
    assert {event.reason.partition(" ")[0] for event in told if isinstance(event, LineLost)} == {
        f"rtu+tcp://127.0.0.1:{number}"
    }


# --- the gateway in front of ser2net ---

LINE = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{scheme}+tcp://127.0.0.1:{number}"
timeout = "4 s"
"""


class Ser2Net:
    """ser2net between a TCP port and a virtual serial port, in raw mode, as Debian ships it."""

    def __init__(self, folder: Path, number: int, port: Path) -> None:
        self._config = folder / "ser2net.yaml"
        self._config.write_text(
            f"connection: &hall\n  accepter: tcp,127.0.0.1,{number}\n  connector: serialdev,{port},19200n81,local\n"
        )
        self._number = number

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(["ser2net", "-n", "-u", "-c", str(self._config)], stderr=subprocess.DEVNULL)
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        """Let it stall: its system takes what comes, and it does nothing."""
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self._process.send_signal(signal.SIGCONT)


class Client:
    """A Modbus TCP client that reads the first register of unit 1."""

    def __init__(self, gateway: GatewayProcess) -> None:
        self._socket = socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE)

    def ask(self) -> bytes:
        self._socket.sendall(READ)
        return self._socket.recv(260)

    def close(self) -> None:
        self._socket.close()


def answers(client: Client) -> None:
    """Ask until the device has answered."""
    deadline = time.monotonic() + PATIENCE
    while (response := client.ask()) != ANSWER:
        assert time.monotonic() < deadline, response.hex(" ")
        time.sleep(0.05)


def until_down(client: Client) -> None:
    """Ask until the gateway has noticed that the server is gone."""
    deadline = time.monotonic() + PATIENCE
    while (response := client.ask())[7:].hex() != "830a":
        assert time.monotonic() < deadline, response.hex(" ")


class ClosesIdle:
    """A server that closes a connection on which nothing came for `idle` seconds."""

    def __init__(self, answers: dict[bytes, bytes], idle: float) -> None:
        self.connections = 0
        self.closed = 0
        self._answers = answers
        self._idle = idle
        self._server = socket.create_server(("127.0.0.1", 0))
        self.number = self._server.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, name="server that closes")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            with connection:
                self.connections += 1
                connection.settimeout(self._idle)
                with suppress(TimeoutError, OSError):
                    while asked := connection.recv(260):
                        connection.sendall(self._answers[asked])
                with suppress(TimeoutError, OSError):  # a request that crosses the end of its connection is lost
                    connection.shutdown(socket.SHUT_WR)
                    connection.settimeout(PATIENCE)
                    connection.recv(260)
            self.closed += 1


@pytest.mark.parametrize("way", ["tcp", "rtu+tcp", "ascii+tcp"])
def test_a_server_that_closes_idle_connections_costs_no_request_and_no_word(tmp_path: Path, way: str) -> None:
    pdus = bytes.fromhex("03 0000 0001"), bytes.fromhex("03 02 0007")
    framing = rtu if way == "rtu+tcp" else ascii_framing
    asked, answer = (framing.encode(1, pdu) for pdu in pdus)
    table = {asked: answer}
    if way == "tcp":
        table = {number.to_bytes(2) + READ[2:]: number.to_bytes(2) + ANSWER[2:] for number in range(1, 50)}
    with ClosesIdle(table, idle=1.0) as server:  # a busy machine needs tenths from connecting to asking
        where = f"{way}://127.0.0.1:{server.number}"
        config = LINE.format(scheme="rtu", number=1).replace("rtu+tcp://127.0.0.1:1", where)
        if way == "tcp":
            config = config.replace("[[line]]", "[[upstream]]").replace("port =", "to =")
            config += "units = [{ as = 1, unit = 1 }]\n"
        stood_still = False
        with GatewayProcess(tmp_path, config) as gateway, closing(Client(gateway)) as client:
            gateway.first("line_up")
            for number in range(1, 4):
                while server.closed < number:
                    time.sleep(0.01)
                began = time.monotonic()
                answer = client.ask()
                stood_still = stood_still or time.monotonic() - began > 0.5
                if not stood_still:  # else it may have waited in vain for the connection, or the server has left it
                    assert server.connections == number + 1
                    assert answer == ANSWER
            assert gateway.stop() == 0
    if not stood_still:
        assert gateway.rest == []
        assert not [event for event in gateway.log if event["event"] in {"line_lost", "line_reopened", "part_failed"}]


@pytest.mark.needs("ser2net")
@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_a_line_behind_ser2net_is_asked_and_found_again(tmp_path: Path, mode: str) -> None:
    device, number = SimulatedDevice(1), free_port()
    device.holding[0] = 7
    config = LINE.format(scheme=mode, number=number)
    with (
        VirtualPort(tmp_path / "line") as port,
        SerialDevices({port: SimulatedLine(mode, device)}),
        GatewayProcess(tmp_path, config) as gateway,
        closing(Client(gateway)) as client,
    ):
        assert "refuses the connection" in gateway.log[1]["reason"]
        assert client.ask()[7:].hex() == "830a"
        with Ser2Net(tmp_path, number, port.path):
            gateway.wait_for("line_up")
            answers(client)
            for _ in range(20):
                assert client.ask() == ANSWER, gateway.log
            device.silent = True
            assert client.ask()[7:].hex() == "830b"
            device.silent = False
        until_down(client)
        gateway.wait_for("line_lost")
        assert client.ask()[7:].hex() == "830a"
        with Ser2Net(tmp_path, number, port.path):
            gateway.wait_for("line_reopened")
            answers(client)
        assert gateway.stop() == 0
    assert gateway.rest == []
    assert not [event for event in gateway.log if event["event"] in {"part_failed", "foreign_frame", "bad_frame"}]


def ask_for(client: Client, address: int) -> str:
    """The response to a read of one register."""
    client._socket.sendall(struct.pack(">HHHBBHH", address, 0, 6, 1, 3, address, 1))
    return client._socket.recv(260)[7:].hex(" ")


@pytest.mark.needs("ser2net")
def test_a_request_that_a_stalled_server_held_back_never_answers_the_next_one(tmp_path: Path) -> None:
    """On a busy machine ser2net may give an answer to the connection after the one that asked (ADR 5): three tries."""
    device, number = SimulatedDevice(1), free_port()
    device.holding = [7, *range(1, 100)]
    config = LINE.format(scheme="rtu", number=number).replace("4 s", "300 ms")
    with (
        VirtualPort(tmp_path / "line") as port,
        SerialDevices({port: SimulatedLine("rtu", device)}),
        Ser2Net(tmp_path, number, port.path) as server,
        GatewayProcess(tmp_path, config) as gateway,
        closing(Client(gateway)) as client,
    ):
        answers(client)
        for stall in (1.2, 1.6):
            assert any(only_right_answers(client, server, stall) for _ in range(3))
        while not any(event["event"] == "connection_renewed" for event in gateway.log):
            stall *= 2  # late windows are longer after answers that were late, as on a busy machine
            assert stall < PATIENCE
            assert any(only_right_answers(client, server, stall) for _ in range(3))


def only_right_answers(client: Client, server: Ser2Net, stall: float) -> bool:
    """Whether a client hears no other register than it asks for while a server stands still, until it answers again."""
    server.stop()
    goes_on = threading.Timer(stall, server.go_on)
    goes_on.start()
    address, heard, is_right = 8, "", True
    while goes_on.is_alive() or not heard.startswith("03"):
        heard = ask_for(client, address)
        is_right &= heard in ("83 0a", "83 0b", f"03 02 00 {address:02x}")
        address = address + 1 if address < 99 else 8
        time.sleep(0.02)
    return is_right


@pytest.mark.needs("ser2net")
def test_a_second_gateway_at_the_same_device_server_hears_why_it_waits(tmp_path: Path) -> None:
    number, device = free_port(), SimulatedDevice(1)
    device.holding[0] = 7
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir()
    other.mkdir()
    config = LINE.format(scheme="rtu", number=number)
    with (
        VirtualPort(tmp_path / "line") as port,
        SerialDevices({port: SimulatedLine("rtu", device)}),
        Ser2Net(tmp_path, number, port.path),
        GatewayProcess(one, config) as first,
        closing(Client(first)) as client,
    ):
        answers(client)
        with GatewayProcess(other, config) as second:
            lost = [event for event in second.log if event["event"] == "line_lost"]
            while not any("is somebody else connected?" in event["reason"] for event in lost):
                lost = [second.wait_for("line_lost")]  # a busy machine may let the server close too late for that
        answers(client)
