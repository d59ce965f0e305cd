"""The keys of `[[upstream]]`, each against a real server that needs it: 20 of 20 reads, and what happens without."""

import json
import signal
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from kit.free_port import free_port
from kit.peers import Libmodbus, Pymodbus
from kit.process import PATIENCE, GatewayProcess, command
from kit.reader import Reader
from kit.tcp_server import Manners, TcpServer

READS = 20
#: Longer than any machine stands still, for servers that answer; as short as what is lost may take.
PATIENT, SHORT = 'timeout = "20 s"', 'timeout = "200 ms"'


@contextmanager
def gateway_at(folder: Path, *numbers: int, keys: str = PATIENT) -> Iterator[GatewayProcess]:
    """A gateway with a server at these ports as its only upstream, under the same units; in the end it stops well."""
    to = [f"tcp://127.0.0.1:{number}" for number in numbers]
    config = f'[[listen]]\nbind = "tcp://127.0.0.1:0"\n[[upstream]]\nname = "roof"\nto = {json.dumps(to)}\n{keys}\n'
    if "units" not in keys:
        config += 'units = [{ unit = "1-4" }]\n'
    with GatewayProcess(folder, config) as gateway:
        until(lambda: any(event["event"] in {"line_up", "line_lost"} for event in list(gateway.log)))
        yield gateway
        assert gateway.stop() == 0
    assert gateway.rest == []
    assert not [event for event in gateway.log if event["event"] == "part_failed"]


def until(is_so: Callable[[], object]) -> None:
    """Wait until it is so."""
    deadline = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def right(unit: int, address: int) -> str:
    """What a TcpServer answers to a read of this register."""
    return f"03 02 {unit:02X} {address:02X}"


def read_all(reader: Reader) -> None:
    """Read so many times: each answer is right."""
    for address in range(READS):
        unit = 1 + address % 4
        assert reader.read(unit, address) == right(unit, address)


def one_fails(reader: Reader) -> None:
    """Read until a read fails."""
    answers: list[str] = []
    deadline = time.monotonic() + PATIENCE
    while not answers or answers[-1] == right(1, len(answers) - 1):
        assert time.monotonic() < deadline
        answers.append(reader.read(1, len(answers) % 256))
    assert answers[-1] == "83 0B"


def status_of(folder: Path) -> dict[str, Any]:
    """The gateway's status of the upstream."""
    status = json.loads(command("status", "--json", "--control", str(folder / "control.sock")).stdout)
    return next(each for each in status["upstreams"] if each["name"] == "roof")


# --- pauses ---


def test_a_server_that_needs_a_pause_before_each_request_gets_it(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(gap=0.05)) as server,
        gateway_at(tmp_path, server.number, keys=f'{PATIENT}\ngap = "50 ms"') as gateway,
        ExitStack() as stack,
    ):
        readers = [stack.enter_context(closing(Reader(gateway.port))) for _ in range(4)]
        with ThreadPoolExecutor(len(readers)) as pool:
            answers = pool.map(lambda reader: [reader.read(1 + n % 4, n) for n in range(5)], readers)
        assert list(answers) == [[right(1 + n % 4, n) for n in range(5)]] * 4
        assert server.lost == []


def test_without_it_requests_are_lost(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(gap=0.05)) as server,
        gateway_at(tmp_path, server.number, keys=SHORT) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        one_fails(reader)


@pytest.mark.parametrize("pause", ["1 s", "0"])
def test_a_server_that_needs_a_pause_after_connecting_gets_it(tmp_path: Path, pause: str) -> None:
    """Only a machine that stands still makes the server answer without it."""
    manners = Manners(settling=0.1 if pause != "0" else 10.0)
    with (
        TcpServer(manners) as server,
        gateway_at(tmp_path, server.number, keys=f'{PATIENT}\nafter_connect = "{pause}"') as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        if pause == "0":
            one_fails(reader)
        else:
            until(lambda: reader.read(1, 5) != "83 0A")  # it connects when it starts
            read_all(reader)
            assert server.connections == 1


def test_a_request_waits_for_the_pause_after_connecting_when_its_server_has_left(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(settling=0.05)) as server,
        gateway_at(tmp_path, server.number, keys=f'{PATIENT}\nafter_connect = "700 ms"') as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        until(lambda: reader.read(1, 5) != "83 0A")
        for number in range(2, 4):
            server.hang_up()
            until(lambda: server.open_connections == 0)
            time.sleep(0.2)  # a request that crosses the end of its connection is lost
            read_all(reader)
            assert server.connections == number


# --- connections ---


def test_the_only_connection_of_a_server_is_left_to_others_when_it_is_idle(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(connections=1)) as server,
        gateway_at(tmp_path, server.number, keys=f'{PATIENT}\nidle = "50 ms"') as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        until(lambda: server.connections == 1)
        for address in range(READS):
            until(lambda: server.open_connections == 0)  # the gateway leaves
            if address % 4 == 0:
                with closing(Reader(server.number)) as other:
                    assert other.read(3, address) == right(3, address)
                until(lambda: server.open_connections == 0)
            assert reader.read(1, address) == right(1, address)
        assert not [event for event in gateway.log if event["event"] in {"line_lost", "line_reopened"}]


def test_without_it_nobody_else_gets_in(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(connections=1)) as server,
        gateway_at(tmp_path, server.number) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        read_all(reader)
        with socket.create_connection(("127.0.0.1", server.number), timeout=PATIENCE) as other:
            assert other.recv(1) == b""
        read_all(reader)
        assert server.open_connections == 1


def test_a_reload_changes_a_key_without_a_second_connection(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(connections=1)) as server,
        gateway_at(tmp_path, server.number) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        read_all(reader)
        gateway.config.write_text(gateway.config.read_text().replace(PATIENT, f"{PATIENT}\nretries = 1"))
        gateway.signal(signal.SIGHUP)
        gateway.wait_for("config_applied")
        until(lambda: reader.read(1, 5) != "83 0A")
        read_all(reader)
        assert server.connections == 2


def test_who_takes_the_only_connection_away_costs_what_is_under_way_and_no_more(tmp_path: Path) -> None:
    """The gateway is closed in order, and comes back with the next request."""
    with (
        TcpServer(Manners(connections=1, newest_stays=True)) as server,
        gateway_at(tmp_path, server.number) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        for _ in range(3):
            read_all(reader)
            with closing(Reader(server.number)) as other:
                assert other.read(3, 7) == right(3, 7)
            time.sleep(0.2)  # a request that crosses the end of its connection is lost


@contextmanager
def black_hole() -> Iterator[int]:
    """A port where nobody answers, as behind a firewall: its backlog is full, and the system drops what comes."""
    with socket.socket() as deaf, socket.socket() as one, socket.socket() as other:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen(0)
        for waiting in (one, other):
            waiting.setblocking(False)
            waiting.connect_ex(deaf.getsockname())
        yield deaf.getsockname()[1]


@contextmanager
def deaf_server() -> Iterator[int]:
    """A server that takes three requests, and answers none."""
    with TcpServer() as server:
        server.is_deaf = True
        yield server.number
        assert len(server.heard) == 3


@pytest.mark.parametrize(
    "dead", [lambda: nullcontext(free_port()), black_hole, deaf_server], ids=["refuses", "black hole", "deaf"]
)
def test_another_address_is_used_when_one_is_dead(
    tmp_path: Path, dead: Callable[[], AbstractContextManager[int]]
) -> None:
    with (
        dead() as first,
        TcpServer() as server,
        gateway_at(tmp_path, first, server.number, keys='timeout = "600 ms"') as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        answers = []
        until(lambda: answers.append(reader.read(1, 5)) or answers[-1] == right(1, 5))
        assert set(answers[:-1]) <= {"83 0A", "83 0B"}
        read_all(reader)


def test_an_address_that_dies_is_left_for_the_other_and_no_request_is_repeated(tmp_path: Path) -> None:
    with ExitStack() as stack, TcpServer() as other:
        first = stack.enter_context(TcpServer())
        with gateway_at(tmp_path, first.number, other.number) as gateway, closing(Reader(gateway.port)) as reader:
            read_all(reader)
            first.holds = True
            with ThreadPoolExecutor(1) as pool:
                written = pool.submit(reader.ask, 1, "06 0001 0002")
                until(lambda: (1, bytes.fromhex("06 0001 0002")) in first.heard)
                stack.close()
                assert written.result(PATIENCE) == "86 0B"
            until(lambda: reader.read(1, 5) == right(1, 5))
            read_all(reader)
            assert [pdu for _, pdu in other.heard if pdu[0] != 3] == []


# --- identifiers ---


def test_a_server_that_always_answers_identifier_0_is_understood(tmp_path: Path) -> None:
    keys = f'{PATIENT}\ntransaction_id = "zero"'
    with (
        TcpServer(Manners(knows_identifiers=False)) as server,
        gateway_at(tmp_path, server.number, keys=keys) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        read_all(reader)
        assert server.connections == 1


def test_without_it_its_answers_are_dropped(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(knows_identifiers=False)) as server,
        gateway_at(tmp_path, server.number, keys=SHORT) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        one_fails(reader)


@pytest.mark.parametrize("manners", [Manners(slowness=0.12), Manners(repeats=True)], ids=["late", "twice"])
def test_an_answer_with_identifier_0_that_is_left_over_reaches_nobody(tmp_path: Path, manners: Manners) -> None:
    """The next request has a connection of its own."""
    keys = 'timeout = "60 ms"\nrest = "off"\ntransaction_id = "zero"'
    manners = Manners(slowness=manners.slowness, repeats=manners.repeats, knows_identifiers=False)
    with (
        TcpServer(manners) as server,
        gateway_at(tmp_path, server.number, keys=keys) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        answers = {address: reader.read(1, address) for address in range(READS)}
        assert {answer for address, answer in answers.items() if answer != right(1, address)} <= {"83 0B", "83 0A"}
        assert server.connections > 1


# --- what is asked at once, and again ---


def test_a_server_that_works_on_one_request_at_a_time_gets_no_more(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(gap=0.0, slowness=0.02)) as server,
        gateway_at(tmp_path, server.number, keys=f"{PATIENT}\nin_flight = 1") as gateway,
        ExitStack() as stack,
    ):
        readers = [stack.enter_context(closing(Reader(gateway.port))) for _ in range(4)]
        with ThreadPoolExecutor(len(readers)) as pool:
            list(pool.map(read_all, readers))
        assert server.lost == []


@pytest.mark.parametrize(("keys", "shared"), [("", True), ("coalesce = false", False)])
def test_equal_reads_that_wait_are_sent_once(tmp_path: Path, keys: str, shared: bool) -> None:
    with (
        TcpServer() as server,
        gateway_at(tmp_path, server.number, keys=f'{PATIENT}\nmax_wait = "20 s"\nin_flight = 1\n{keys}') as gateway,
        ExitStack() as stack,
    ):
        first, *others = (stack.enter_context(closing(Reader(gateway.port))) for _ in range(1 + READS))
        server.holds = True
        with ThreadPoolExecutor(1 + READS) as pool:
            pool.submit(first.read, 1, 7)
            until(lambda: len(server.heard) == 1)
            answers = [pool.submit(reader.read, 1, 5) for reader in others]
            until(lambda: status_of(tmp_path)["queue"] == READS)
            server.release()
            assert {each.result(PATIENCE) for each in answers} == {right(1, 5)}
        assert len(server.heard) == (2 if shared else 1 + READS)


def test_a_read_that_gets_lost_is_repeated(tmp_path: Path) -> None:
    keys = 'timeout = "400 ms"\nretries = 3'
    with (
        TcpServer(Manners(loses_each=7)) as server,
        gateway_at(tmp_path, server.number, keys=keys) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        read_all(reader)
        assert len(server.lost) >= 2


def test_without_it_the_client_has_to_and_a_write_is_never_repeated(tmp_path: Path) -> None:
    with (
        TcpServer(Manners(loses_each=3)) as server,
        gateway_at(tmp_path, server.number, keys=SHORT) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        one_fails(reader)
    write = "06 0001 0002"
    with (
        TcpServer(Manners(loses_each=1)) as server,
        gateway_at(tmp_path, server.number, keys=f"{SHORT}\nretries = 3") as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        assert reader.ask(1, write) == "86 0B"
        assert server.heard == [(1, bytes.fromhex(write))]


@pytest.mark.parametrize("where", ["the upstream", "the unit"])
def test_a_device_that_sleeps_is_woken(tmp_path: Path, where: str) -> None:
    """The first request after a pause is lost."""
    keys = 'timeout = "800 ms"\n'
    keys += 'wake = "1 ms"' if where == "the upstream" else 'units = [{ unit = "1-4", wake = "1 ms" }]'
    with (
        TcpServer() as server,
        gateway_at(tmp_path, server.number, keys=keys) as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        for address in range(READS):
            server.is_asleep = address % 10 == 0
            time.sleep(0.005)
            assert reader.read(1, address) == right(1, address)
        assert len(server.lost) == 2
        server.is_asleep = True
        assert reader.ask(1, "06 0001 0002") == "86 0B"  # only reads are sent twice
        assert len(server.lost) == 3


# --- what waits, and what rests ---


def test_what_does_not_fit_into_the_queue_or_waits_too_long_is_busy(tmp_path: Path) -> None:
    with (
        TcpServer() as server,
        gateway_at(tmp_path, server.number, keys=f'{PATIENT}\nin_flight = 1\nqueue = 1\nmax_wait = "1 s"') as gateway,
        ExitStack() as stack,
    ):
        readers = [stack.enter_context(closing(Reader(gateway.port))) for _ in range(3)]
        server.holds = True
        with ThreadPoolExecutor(3) as pool:
            answers = [pool.submit(readers[0].read, 1, 0)]
            until(lambda: len(server.heard) == 1)
            answers += [pool.submit(reader.read, 1, 1 + at) for at, reader in enumerate(readers[1:])]
            assert [each.result(PATIENCE) for each in answers[1:]] == ["83 06", "83 06"]
            server.release()
            assert answers[0].result(PATIENCE) == right(1, 0)
        assert len(server.heard) == 1


@pytest.mark.parametrize(("rest", "asked"), [("off", 6), ("auto", 3)])
def test_a_unit_that_fails_rests_unless_it_must_not(tmp_path: Path, rest: str, asked: int) -> None:
    with (
        TcpServer() as server,
        gateway_at(tmp_path, server.number, keys=f'timeout = "50 ms"\nrest = "{rest}"') as gateway,
        closing(Reader(gateway.port)) as reader,
    ):
        server.is_deaf = True
        assert {reader.read(1, address) for address in range(6)} == {"83 0B"}
        assert len(server.heard) == asked


# --- servers that others have written ---


@pytest.mark.parametrize(
    ("peer", "in_flight"), [(Pymodbus, 1), pytest.param(Libmodbus, 16, marks=pytest.mark.needs("libmodbus.so.5"))]
)
def test_a_real_server_answers_each_client(tmp_path: Path, peer: type[Pymodbus | Libmodbus], in_flight: int) -> None:
    number = free_port()
    with (
        gateway_at(tmp_path, number, keys=f"{PATIENT}\nin_flight = {in_flight}") as gateway,
        peer(number),
        ExitStack() as stack,
    ):
        readers = [stack.enter_context(closing(Reader(gateway.port))) for _ in range(4)]
        until(lambda: readers[0].read(1, 0) == "03 02 01 00")

        def read_and_write(unit: int) -> list[str]:
            reader = readers[unit - 1]
            reads = [reader.read(unit, unit * READS + at) for at in range(READS)]
            writes = [reader.ask(unit, f"06 {unit * READS + at:04X} {100 * unit + at:04X}") for at in range(READS)]
            return reads + writes + [reader.read(unit, unit * READS + at) for at in range(READS)]

        with ThreadPoolExecutor(4) as pool:
            answers = list(pool.map(read_and_write, range(1, 5)))
    for unit, got in enumerate(answers, start=1):
        high = 1 if peer is Libmodbus else unit
        places = [(unit * READS + at, 100 * unit + at) for at in range(READS)]
        assert got[:READS] == [f"03 02 {high:02X} {address:02X}" for address, _ in places]
        assert got[READS : 2 * READS] == [
            bytes((6, *divmod(a, 256), *divmod(v, 256))).hex(" ").upper() for a, v in places
        ]
        assert got[2 * READS :] == [f"03 02 {value >> 8:02X} {value & 255:02X}" for _, value in places]
