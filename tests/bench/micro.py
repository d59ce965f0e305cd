"""What the pieces of a request's way cost without a kernel, each beside an empty call of Python in the same run.

    ./deploy/go compile && .venv/bin/python tests/bench/micro.py

The best of several repetitions: other work on the machine can only make a piece slower. `whole way` is a request from
the client's bytes to the line's and back, with everything but sockets, ports and the loop.
"""

import asyncio
from collections.abc import Callable
from timeit import Timer

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.events import Emit
from gateway.listeners.sessions.mbap import MbapSession
from gateway.listeners.sessions.session import Connection
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.modbus.ascii import lrc
from gateway.modbus.pdu import parse_anew, parse_request
from gateway.modbus.rtu import crc16
from gateway.modbus.scan import Expected, Scanner
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import RtuScanner
from gateway.request import Caller
from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running
from gateway.timing.budget import AnswerTime, Budget
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.timing.table import TimingTable

REPETITIONS = 9
#: How long one repetition takes, in seconds.
STEP = 0.02

UNIT = 17
TIMING = LineTiming("rtu", 19200, CharacterFormat.parse("8N1"))
CONFIG = """
[[line]]
name = "line"
port = "/dev/ttyS0"
format = "8N1"
gap = "0"
"""
ANSWER_TIME = AnswerTime(TimingTable(), margin=1.5, timeout=0.5)

Piece = tuple[str, Callable[[], object]]


def read(count: int) -> tuple[bytes, bytes]:
    """A request for so many holding registers, and its response."""
    return bytes((3, 0, 16, 0, count)), bytes((3, 2 * count)) + bytes(range(2 * count))


class Table(Connection):
    """A session, a router and a line on a table: it answers each request as soon as it is on the line."""

    is_virtual = True
    has_arrived = None
    latency = 0.0

    def __init__(self, count: int) -> None:
        request, response = read(count)
        loop = asyncio.get_running_loop()
        self._adu = mbap.encode(7, UNIT, request)
        self._frame = rtu.encode(UNIT, response)
        self._loop = loop
        self._sent = b""
        gateway = running(CONFIG, print)
        listener, line = gateway.listeners[0], gateway.lines[0]
        self._session = MbapSession(
            Caller("127.0.0.1:49152", "127.0.0.1", "127.0.0.1"),
            router=listener.router,
            connection=self,
            settings=listener.settings,
            now=loop.time(),
        )
        self._line = line.driver
        self._line.port_up(self)

    def time(self) -> float:
        return self._loop.time()

    def ask(self) -> None:
        """One request, its response."""
        self._session.room()[: len(self._adu)] = self._adu
        self._session.received(len(self._adu), self.time())
        self._line.received(self._frame)
        if not self._sent:
            raise AssertionError("no response")
        self._sent = b""

    def write(self, data: bytes) -> None:
        """The line."""

    def read_now(self) -> None:
        """Nothing stands unread on the line."""

    def receive(self, room: memoryview) -> int:
        """Nor from the client."""
        return 0

    def send(self, data: bytes) -> None:
        """The client."""
        self._sent = data


def running(config: str, emit: Emit) -> Gateway:
    """A gateway with this config."""
    plan = resolve(parse(config, port_trouble=lambda _: None, real_path=lambda port: port).config)
    return Running(plan, lambda _: None, emit).gateway


def finding(scanner: Scanner, count: int) -> Callable[[], object]:
    request, response = read(count)
    asked, sent, frame = parse_request(request), scanner.encode(UNIT, request), scanner.encode(UNIT, response)

    def find() -> None:
        scanner.expect(Expected(UNIT, asked), sent, echoes=False)
        if not scanner.received(frame, 0.0):
            raise AssertionError("no frame")

    return find


def cutting() -> Callable[[], object]:
    framer, adu = mbap.MbapFramer(), mbap.encode(7, UNIT, read(10)[0])

    def cut() -> None:
        framer.room()[: len(adu)] = adu
        framer.filled(len(adu))
        framer.next()

    return cut


def pieces() -> list[Piece]:
    request, response = read(10)
    asked, budget = parse_request(request), Budget(TIMING, 0.005)
    ascii_encode = ascii_framing.encode
    return [
        ("CRC of 23 bytes", lambda: crc16(bytes(23))),
        ("LRC of 23 bytes", lambda: lrc(bytes(23))),
        ("read a request PDU, known", lambda: parse_request(request)),
        ("read a request PDU, new", lambda: parse_anew(request)),
        ("time limit of a request", lambda: budget.limit(asked, ANSWER_TIME)),
        ("response fits request", lambda: asked.accepts(response)),
        ("RTU frame made", lambda: rtu.encode(UNIT, request)),
        ("RTU response found, 10 registers", finding(RtuScanner(), 10)),
        ("RTU response found, 125 registers", finding(RtuScanner(), 125)),
        ("ASCII frame made", lambda: ascii_encode(UNIT, request)),
        ("ASCII response found, 10 registers", finding(AsciiScanner(), 10)),
        ("MBAP request cut", cutting()),
        ("MBAP response made", lambda: mbap.encode(7, UNIT, response)),
        ("whole way, 10 registers", Table(10).ask),
        ("whole way, 125 registers", Table(125).ask),
    ]


def seconds(call: Callable[[], object]) -> float:
    """How long one call takes."""
    timer = Timer(call)
    number = max(1, int(STEP / (timer.timeit(100) / 100)))
    return min(timer.repeat(REPETITIONS, number)) / number


async def main() -> None:
    """Measure and print."""
    call = seconds(lambda: None)
    print(f"| piece | us | x an empty call ({call * 1e6:.3f} us) |\n|---|---:|---:|")
    for name, piece in pieces():
        took = seconds(piece)
        print(f"| {name} | {took * 1e6:.2f} | {took / call:.0f} |", flush=True)


if __name__ == "__main__":
    asyncio.run(main())
