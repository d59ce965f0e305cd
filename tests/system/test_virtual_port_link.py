"""Virtual ports, with real pseudo-terminals: what each program gets, whatever happens between two looks."""

import asyncio
import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.errors import PortClosed, PortError
from gateway.events import discard_event
from gateway.listeners.programs import ProgramListener
from gateway.listeners.sessions.server_line import ServerSettings
from gateway.modbus.rtu import encode
from gateway.ports.port import PtySettings
from gateway.ports.pty_link import MOST_PROGRAMS, PtyLink, open_pty
from gateway.ports.pty_port import PtyPort
from gateway.request import Request, Target
from gateway.timing.characters import CharacterFormat, LineTiming


class Session:
    """The user of a program's port. It notes what happens."""

    def __init__(self, port: PtyPort) -> None:
        self.port = port
        self.heard: list[bytes | str] = []

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        assert not damaged
        self.heard.append(data)

    def give_up(self) -> None:
        self.heard.append("given up")

    def lost(self, error: PortError) -> None:
        self.heard.append(str(error))


class Bench:
    """A link, and the sessions behind it in the order in which their ports were made."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "ttyHMI"
        self.sessions: list[Session] = []
        self.lost: list[PortError] = []
        self.received = lambda _: None
        self._programs: list[int] = []

    async def open(self) -> PtyLink:
        class User:
            received = self.received
            lost = self.lost.append

        self.link = await open_pty(PtySettings("pty:ttyHMI", "ttyHMI", "dialout", 0.0), self.path.parent, User())
        self.link.serve(self._came)
        return self.link

    def program(self) -> int:
        """Open the port as a program."""
        port = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._programs.append(port)
        return port

    def leave(self, port: int) -> None:
        self._programs.remove(port)
        os.close(port)

    def close(self) -> None:
        self.link.close()
        for port in self._programs:
            os.close(port)

    def _came(self, port: PtyPort) -> Session:
        self.sessions.append(Session(port))
        return self.sessions[-1]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    bench.close()


async def until(is_so: Callable[[], object]) -> None:
    async with asyncio.timeout(10):
        while not is_so():  # noqa: ASYNC110 - what happens is told to nobody
            await asyncio.sleep(0.001)


def open_files() -> int:
    gc.collect()  # what earlier tests have left open
    return len(list(Path("/proc/self/fd").iterdir()))


def read(port: int) -> bytes:
    """All that a program can read now."""
    try:
        return os.read(port, 300)
    except BlockingIOError:
        return b""


async def test_bytes_in_both_directions_are_what_they_were(bench: Bench) -> None:
    await bench.open()
    program, every_byte = bench.program(), bytes(range(256))
    os.write(program, every_byte)
    await until(lambda: sum(map(len, bench.sessions[0].heard)) == 256)
    assert b"".join(map(bytes, bench.sessions[0].heard)) == every_byte
    bench.sessions[0].port.write(every_byte)
    got = b""
    async with asyncio.timeout(10):
        while len(got) < 256:
            got += read(program)
            await asyncio.sleep(0.001)
    assert got == every_byte
    assert not bench.sessions[0].port.errors


async def test_the_next_program_gets_another_port_from_the_first_byte_on(bench: Bench) -> None:
    await bench.open()
    first = bench.program()
    os.write(first, b"first")
    await until(lambda: bench.sessions[0].heard)
    second = bench.program()
    os.write(second, b"second")
    await until(lambda: len(bench.sessions) > 1 and bench.sessions[1].heard)
    bench.sessions[0].port.write(b"for the first")
    await until(lambda: read(first) == b"for the first")
    assert read(second) == b""


async def test_what_the_first_has_asked_and_not_read_is_gone_with_it(bench: Bench) -> None:
    await bench.open()
    first = bench.program()
    os.write(first, b"first")
    await until(lambda: bench.sessions[0].heard)
    bench.sessions[0].port.write(b"for the first")
    bench.leave(first)
    second = bench.program()  # before the gateway could look
    await until(lambda: len(bench.sessions[0].heard) > 1)
    bench.sessions[0].port.write(b"too late")
    await asyncio.sleep(0.05)
    assert bench.sessions[0].heard[1:] == ["the program has closed the port"]
    assert read(second) == b""


async def test_who_comes_before_the_gateway_could_look_hears_nothing_of_the_one_before(bench: Bench) -> None:
    await bench.open()
    first = bench.program()
    os.write(first, b"first")
    bench.leave(first)
    second = bench.program()
    os.write(second, b"second")
    await until(lambda: bench.sessions[0].heard)
    assert bench.sessions[0].heard == ["given up"]
    bench.sessions[0].port.write(b"an answer to the first")  # only a session that has asked nothing could do that
    os.write(second, b"again")
    await until(lambda: len(bench.sessions[0].heard) > 1)
    assert bench.sessions[0].heard[1] == b"again"


async def test_one_that_has_only_looked_takes_nothing_away(bench: Bench) -> None:
    await bench.open()
    bench.leave(bench.program())
    second = bench.program()
    os.write(second, b"second")
    await until(lambda: any(session.heard for session in bench.sessions))
    assert [session.heard for session in bench.sessions if session.heard] == [[b"second"]]


async def test_once_a_program_has_opened_it_the_link_leads_elsewhere(bench: Bench) -> None:
    await bench.open()
    before = bench.path.readlink()
    first = bench.program()
    await until(lambda: bench.path.readlink() != before)
    other = bench.program()
    for port, text in ((other, b"other"), (first, b"first")):
        os.write(port, text)
    await until(lambda: bench.sessions[0].heard and bench.sessions[1].heard)
    assert [session.heard for session in bench.sessions[:2]] == [[b"first"], [b"other"]]
    bench.leave(first)
    await until(lambda: "the program has closed the port" in bench.sessions[0].heard)
    assert bench.sessions[1].heard == [b"other"]


async def test_who_shares_a_port_has_it_until_the_last_one_leaves(bench: Bench) -> None:
    await bench.open()
    first, other = bench.program(), bench.program()  # at the same moment
    bench.leave(first)
    await asyncio.sleep(0.05)
    assert bench.sessions[0].heard == []
    bench.leave(other)
    await until(lambda: bench.sessions[0].heard)
    assert bench.sessions[0].heard == ["the program has closed the port"]


async def test_who_shares_a_port_goes_on_when_one_has_left_that_was_answered(bench: Bench) -> None:
    await bench.open()
    first, other = bench.program(), bench.program()
    os.write(first, b"first")
    await until(lambda: bench.sessions[0].heard)
    bench.sessions[0].port.write(b"answer")
    assert read(first) == b"answer"
    bench.leave(first)
    os.write(other, b"other")
    await until(lambda: len(bench.sessions[0].heard) > 1)
    assert bench.sessions[0].heard == [b"first", b"other"]


async def test_who_shares_a_port_does_not_get_what_was_for_one_that_has_left(bench: Bench) -> None:
    await bench.open()
    first, other = bench.program(), bench.program()
    os.write(first, b"first")
    await until(lambda: bench.sessions[0].heard)
    bench.leave(first)
    bench.sessions[0].port.write(b"answer")  # the gateway has not looked since
    assert bench.sessions[0].heard == [b"first", "given up"]
    assert read(other) == b""


async def test_a_response_does_not_hide_what_else_was_asked_by_one_that_leaves(bench: Bench) -> None:
    await bench.open()
    first, other = bench.program(), bench.program()
    os.write(first, b"first")
    await until(lambda: bench.sessions[0].heard)
    os.write(first, b"more")
    bench.sessions[0].port.write(b"answer")  # the gateway has not read the rest
    bench.leave(first)
    bench.sessions[0].port.read_now()
    assert bench.sessions[0].heard == [b"first", "given up"]
    assert read(other) == b""


async def test_a_response_that_was_not_read_is_taken_back(bench: Bench) -> None:
    await bench.open()
    first, other = bench.program(), bench.program()
    os.write(first, b"first")
    await until(lambda: bench.sessions[0].heard)
    bench.sessions[0].port.write(b"answer")
    bench.leave(first)
    bench.sessions[0].port.read_now()
    assert read(other) == b""


async def test_there_are_only_so_many_programs(bench: Bench) -> None:
    await bench.open()
    for number in range(MOST_PROGRAMS):
        os.write(bench.program(), b"request")
        await until(lambda number=number: len(bench.sessions) > number + 1 and bench.sessions[number].heard)
    one_more = bench.program()
    os.write(one_more, b"request")
    await until(lambda: bench.sessions[MOST_PROGRAMS].heard)
    assert bench.sessions[MOST_PROGRAMS].heard == [str(PortClosed())]
    with pytest.raises(OSError, match="Input/output"):
        os.write(one_more, b"request")


async def test_whoever_comes_while_the_gateway_ends_is_not_answered(bench: Bench) -> None:
    class Router(Target):
        def submit(self, request: Request, now: float) -> None:
            asked.append(request)

    asked: list[Request] = []
    link = await bench.open()
    settings = ServerSettings("hmi", LineTiming("rtu", 19200, CharacterFormat(8, "N", 1)), frozenset({1}))
    listener = ProgramListener(settings, Router(), asyncio.get_running_loop(), discard_event)
    listener.port_up(link)
    for number in range(3):
        if number == 1:
            listener.finish()
        before = bench.path.readlink()
        os.write(bench.program(), encode(1, bytes.fromhex("03 0000 0001")))
        await until(lambda before=before: bench.path.readlink() != before)
        await asyncio.sleep(0.05)
        assert len(asked) == 1
    listener.close()


async def test_the_end(bench: Bench) -> None:
    link = await bench.open()
    program = bench.program()
    os.write(program, b"request")
    await until(lambda: bench.sessions[0].heard)
    link.close()
    link.close()
    assert not bench.path.is_symlink()
    assert [type(error) for error in bench.lost] == [PortClosed]
    assert bench.sessions[0].heard == [b"request", str(PortClosed())]
    with pytest.raises(OSError, match="Input/output"):
        os.write(program, b"more")


async def test_a_place_that_somebody_has_taken_ends_it(bench: Bench) -> None:
    await bench.open()
    program = bench.program()
    bench.path.unlink()
    bench.path.write_text("mine")
    os.write(program, b"request")
    await until(lambda: bench.lost)
    assert "was replaced by something else" in str(bench.lost[0])
    assert bench.path.read_text() == "mine"
    assert bench.sessions[0].heard == [str(PortClosed())]


async def test_nothing_is_left_open(bench: Bench) -> None:
    link, before = await bench.open(), open_files()
    for _ in range(5):
        program = bench.program()
        os.write(program, b"request")
        count = len(bench.sessions)
        await until(lambda count=count: bench.sessions[count - 1].heard)
        bench.leave(program)
        await until(lambda count=count: len(bench.sessions[count - 1].heard) > 1)
    await until(lambda: open_files() == before)  # a thread closes the watches
    link.close()
    await until(lambda: open_files() == before - 2)
