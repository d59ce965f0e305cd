"""Every way in and every way out at once, with faults on every line: whoever gets data gets its own.

Units 11-13 are on an RTU line, 21-23 on an ASCII line, 31-33 behind a device server, 41-43 behind another Modbus TCP
server, 50 is an image, 60 a mirror of 11. What a register holds says whose it is.
"""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from random import Random

import pytest

from gateway.listeners.sessions.peer import Path, Peer
from gateway.modbus import rtu
from gateway.modbus.codes import Area
from gateway.modbus.mbap import MbapFramer, TcpFrame, encode
from gateway.request import Caller
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import FaultyDevice, FaultyLine, word
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.over_tcp import OverTcpClient

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:5021"
[[listen]]
bind = "rtu+tcp://127.0.0.1:5022"
[[listen]]
bind = "ascii+tcp://127.0.0.1:5023"
[[listen]]
bind = "udp://127.0.0.1:5024"

[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [{ unit = "1-3", as = "11-13", timeout = "50 ms", name = "silo-*" }]

[[line]]
name    = "press"
port    = "/dev/press"
mode    = "ascii"
devices = [{ unit = "1-3", as = "21-23", timeout = "50 ms" }]

[[line]]
name    = "far"
port    = "rtu+tcp://10.0.0.7:4001"
latency = "5 ms"
devices = [{ unit = "1-3", as = "31-33", timeout = "50 ms" }]

[[line]]
name    = "panel"
port    = "/dev/panel"
role    = "server"
serves  = ["11-13", "21-23", "31-33", "41-43", 50, 60]

[[upstream]]
name    = "plant"
to      = "tcp://10.1.0.5:502"
timeout = "100 ms"
units   = [{ as = "41-43", unit = "1-3" }]

[[image]]
unit    = 50
holding = 100
initial.holding = [{ at = 0, values = VALUES }]

[[image]]
unit  = 60
of    = "silo-11"
read  = [{ holding = "0-99", every = "300 ms" }]
stale = "2 s"
""".replace("VALUES", str([word(50, Area.HOLDING, address) for address in range(100)]))
UNITS = [11, 12, 13, 21, 22, 23, 31, 32, 33, 41, 42, 43, 50, 60]
DURATION = 120.0


def right(unit: int, address: int) -> bytes:
    """The response PDU to a read of one register."""
    return bytes((3, 2)) + word(11 if unit == 60 else unit, Area.HOLDING, address).to_bytes(2)


class Tally:
    """What clients got, by their kind."""

    def __init__(self) -> None:
        self.got: Counter[tuple[str, str]] = Counter()
        self.wrong: list[str] = []

    def note(self, kind: str, unit: int, address: int, pdu: bytes) -> None:
        if pdu == right(unit, address):
            self.got[kind, "data"] += 1
        elif len(pdu) == 2 and pdu[0] == 0x83:
            self.got[kind, "exception"] += 1
        elif not pdu:
            self.got[kind, "nothing"] += 1
        else:
            self.wrong.append(f"{kind}: {pdu.hex(' ')} for {address} of {unit}")


class Server:
    """The other Modbus TCP server: sometimes late, sometimes silent, in any order."""

    def __init__(self, bench: GatewayBench, dice: Random) -> None:
        self._line = bench.lines["tcp://10.1.0.5:502"]
        self._line.on_write = self._take
        self._framer = MbapFramer()
        self._dice = dice

    def _take(self, data: bytes) -> None:
        for adu in self._framer.cut(data):
            address = int.from_bytes(adu.pdu[1:3])
            answer = encode(adu.transaction, adu.unit, right(40 + adu.unit, address))
            if self._dice.random() < 0.95:
                delay = self._dice.choice([0.005, 0.01, 0.02, 0.15, 0.3])
                asyncio.get_running_loop().call_later(delay, self._line.deliver, answer)


class Panel:
    """The outside client on the serial line: what comes after its question is the answer to it."""

    def __init__(self, bench: GatewayBench) -> None:
        self._line = bench.lines["panel"]
        self._line.on_write = self._heard
        self._answer = b""

    async def ask(self, unit: int, address: int, time_out: float) -> bytes:
        self._answer = b""
        self._line.deliver(rtu.encode(unit, bytes((3, 0, address, 0, 1))))
        await asyncio.sleep(time_out)
        return self._answer[1:-2] if self._answer[:1] == bytes((unit,)) else self._answer

    def _heard(self, data: bytes) -> None:
        self._answer += data


class UdpClient:
    """Asks by datagrams, some of them twice."""

    def __init__(self, bench: GatewayBench, dice: Random) -> None:
        self._dice = dice
        self._answers: dict[int, bytes] = {}
        listener = bench.gateway.listeners[3]
        path = Path(lambda: None, self._take)
        caller = Caller("10.0.0.5:1", "127.0.0.1", "127.0.0.1")
        self._peer = Peer(caller, router=listener.router, settings=listener.settings, path=path)
        self._transaction = 0

    async def ask(self, unit: int, address: int, time_out: float) -> bytes:
        self._transaction += 1
        frame = TcpFrame(self._transaction, unit, bytes((3, 0, address, 0, 1)))
        for _ in range(self._dice.choice([1, 1, 2])):
            self._peer.received(frame, asyncio.get_running_loop().time())
        await asyncio.sleep(time_out)
        return self._answers.pop(frame.transaction, b"")

    def _take(self, datagram: bytes) -> None:
        (adu,) = _cut(datagram)
        self._answers[adu.transaction] = adu.pdu


def _cut(datagram: bytes) -> list[TcpFrame]:
    return list(MbapFramer().cut(datagram))


Ask = Callable[[int, int, float], Awaitable[bytes]]


def furnish(bench: GatewayBench, seed: int) -> None:
    """Devices on all lines, each line with every fault that can be noticed."""
    formats = {"rtu": CharacterFormat(8, "E", 1), "ascii": CharacterFormat(7, "E", 1)}
    for port, mode, first in (("hall", "rtu", 11), ("press", "ascii", 21), ("rtu+tcp://10.0.0.7:4001", "rtu", 31)):
        devices = [FaultyDevice(unit, number=first - 1 + unit) for unit in (1, 2, 3)]
        timing = LineTiming(mode, 19200, formats[mode])
        bench.attach(port, FaultyLine(timing, *devices, share=0.2, seed=seed + first))
    Server(bench, Random(seed))


async def poll(kind: str, ask: Ask, dice: Random, tally: Tally) -> None:
    """Ask for DURATION, patiently or not."""
    loop = asyncio.get_running_loop()
    end = loop.time() + DURATION
    while loop.time() < end:
        unit, address = dice.choice(UNITS), dice.randrange(100)
        tally.note(kind, unit, address, await ask(unit, address, dice.choice([0.08, 0.2, 0.5, 1.5])))


def patient(bench: GatewayBench, number: int) -> Ask:
    """A Modbus TCP client: the transaction identifier says what an answer belongs to, so it may wait."""
    client = bench.client(f"10.0.0.{number}:1")

    async def ask(unit: int, address: int, _time_out: float) -> bytes:
        return bytes.fromhex(await client.asks(unit, f"03 {address:04X} 0001"))

    return ask


def over_tcp(bench: GatewayBench, listener: int) -> Ask:
    client = OverTcpClient(bench.gateway.listeners[listener], f"10.0.1.{listener}:1")

    async def ask(unit: int, address: int, time_out: float) -> bytes:
        adu = await client.asks(f"03 {address:04X} 0001", time_out, unit)
        return client.pdu_of(adu, unit)

    return ask


@pytest.mark.search
@pytest.mark.parametrize("seed", [1, 2])
async def test_whoever_gets_data_gets_its_own(seed: int) -> None:
    tally = Tally()
    async with gateway_bench(CONFIG) as bench:
        furnish(bench, seed)
        ways: dict[str, Ask] = {f"tcp {number}": patient(bench, number) for number in range(6)}
        ways |= {"rtu+tcp": over_tcp(bench, 1), "ascii+tcp": over_tcp(bench, 2)}
        ways |= {"udp": UdpClient(bench, Random(seed)).ask, "panel": Panel(bench).ask}
        async with asyncio.TaskGroup() as group:
            for number, (kind, ask) in enumerate(ways.items()):
                group.create_task(poll(kind, ask, Random(100 * seed + number), tally))
    assert tally.wrong == []
    for kind in ways:
        assert tally.got[kind, "data"] > 30, tally.got
