"""A whole gateway in virtual time: config from a string, lines in memory, clients driven by the test."""

import asyncio
from collections.abc import Mapping
from contextlib import asynccontextmanager, closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from gateway.clock.lazy_timer import LazyTimer
from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.config.values.port import DEFAULT_FORMATS
from gateway.events import Event
from gateway.images.custom_unit import CustomUnit
from gateway.images.drivers.store import Store
from gateway.listeners.sessions.mbap import MbapSession
from gateway.listeners.sessions.session import Connection
from gateway.modbus import mbap
from gateway.modbus.frame import Frame
from gateway.ports.listening import open_to_listen
from gateway.ports.port import OpenPort, PortSettings, SerialSettings, TcpSettings
from gateway.request import Caller
from gateway.runtime.gateway import Gateway
from gateway.runtime.kept_state import KeptState
from gateway.runtime.overdue import LeftBehind
from gateway.runtime.running import Running
from gateway.simulator.device import Device, Mode
from gateway.simulator.paced_line import PacedLine
from gateway.state.memory import Memory
from kit.device import SimulatedDevice, SimulatedLine
from kit.memory import MemoryLine

#: How long a test waits for a response, in virtual seconds.
PATIENCE = 30.0


class Client(Connection):
    """A Modbus TCP client without a socket. `responses` holds (transaction, unit, PDU in hex) as they came."""

    def __init__(
        self, gateway: Gateway, name: str = "10.0.0.9:49152", *, host: str = "127.0.0.1", listener: int = 0
    ) -> None:
        self._loop = asyncio.get_running_loop()
        door = gateway.listeners[listener]
        self.session = MbapSession(
            Caller(name, host, host),
            router=door.router,
            connection=self,
            settings=door.settings,
            now=self._loop.time(),
        )
        self.responses: asyncio.Queue[tuple[int, int, str]] = asyncio.Queue()
        self.came_at = 0.0
        self._transaction = 0
        self._from_gateway = mbap.MbapFramer()

    def now(self) -> float:
        """Virtual seconds."""
        return self._loop.time()

    def ask(self, unit: int, pdu: str) -> int:
        """Send a request; its transaction identifier."""
        self._transaction += 1
        adu = mbap.encode(self._transaction, unit, bytes.fromhex(pdu))
        self.session.room()[: len(adu)] = adu
        self.session.received(len(adu), self._loop.time())
        return self._transaction

    async def answer(self) -> str:
        """The next response's PDU."""
        async with asyncio.timeout(PATIENCE):
            _, _, pdu = await self.responses.get()
        return pdu

    async def asks(self, unit: int, pdu: str) -> str:
        """Send a request and wait for its response."""
        self.ask(unit, pdu)
        return await self.answer()

    def receive(self, room: memoryview) -> int:
        return 0

    def send(self, data: bytes) -> None:
        self.came_at = self._loop.time()
        self._from_gateway.room()[: len(data)] = data
        self._from_gateway.filled(len(data))
        while adu := self._from_gateway.next():
            self.responses.put_nowait((adu.transaction, adu.unit, adu.pdu.hex(" ").upper()))

    def time(self) -> float:
        return self._loop.time()

    def pause(self) -> None:
        pass

    def resume(self) -> None:
        self._loop.call_soon(lambda: self.session.proceed(self._loop.time()))

    def release_after(self, seconds: float) -> None:
        self._loop.call_later(seconds, self.session.release)

    def close(self) -> None:
        self.session.closed()

    def reject(self, reason: str) -> None:
        self.session.closed()


class GatewayBench:
    """A running gateway, and the far end of each of its lines and connections.

    Keys of `lines` and `opened` (the settings each was opened with) are port paths without /dev/. What is written to
    a line in `holding_back` has not arrived yet. `running` has no line open: `gateway_bench` opens them.
    """

    def __init__(
        self,
        config: str,
        memory: Memory | None = None,
        state: Path | None = None,
        left_behind: LeftBehind | None = None,
        units: Mapping[int, CustomUnit] | None = None,
    ) -> None:
        loaded = parse(config, port_trouble=lambda port: None, real_path=lambda port: port)
        assert loaded.config is not None, "\n".join(map(str, loaded.problems))
        self.events: list[Event] = []
        self.lines: dict[str, MemoryLine] = {}
        self.opened: dict[str, SerialSettings] = {}
        self.holding_back: set[str] = set()
        self.memory = memory or Memory()
        self._store = None if state is None else Store(state, self.events.append)
        kept = KeptState(memory=self.memory, store=self._store, left_behind=left_behind or LeftBehind())
        self.running = Running(resolve(loaded.config), self._open, self.events.append, kept, units=units)
        self.gateway = self.running.gateway
        self.recent = self.running.recent

    async def reload(self, config: str) -> None:
        """Switch to another config."""
        await self.running.switch(self.rebuilt(config))
        self.gateway = self.running.gateway

    def rebuilt(self, config: str) -> Gateway:
        """The gateway of another config, with what is the same in both."""
        loaded = parse(config, port_trouble=lambda port: None, real_path=lambda port: port)
        assert loaded.config is not None, "\n".join(map(str, loaded.problems))
        return self.running.builder.build(resolve(loaded.config), self.gateway)

    def drop_lines(self) -> None:
        """Let a gateway apply that has no lines, as at once after a reload that removes them."""
        gateway = self.gateway
        plan = replace(gateway.plan, lines=(), mirrors=())
        self.running.apply(replace(gateway, plan=plan, lines=(), devices=(), mirrors=()))

    def close(self) -> None:
        """Close what persistent images are kept in."""
        if self._store is not None:
            self._store.close()

    def client(self, name: str = "10.0.0.9:49152", *, host: str = "127.0.0.1", listener: int = 0) -> Client:
        return Client(self.gateway, name, host=host, listener=listener)

    def attach(self, port: str, devices: SimulatedLine) -> None:
        """Connect simulated devices to the line at `port`."""
        loop = asyncio.get_running_loop()
        line = self.lines[port]

        def answer(data: bytes) -> None:
            for delay, response in devices.received(data, loop.time()):
                loop.call_later(delay, line.deliver, response)

        line.on_write = answer

    def attach_server(self, to: str, *devices: SimulatedDevice) -> None:
        """Let simulated devices answer behind the server at the address `to` of an upstream."""
        loop, line, framer = asyncio.get_running_loop(), self.lines[to], mbap.MbapFramer()

        def answer(data: bytes) -> None:
            for asked in framer.cut(data):
                frame, answering = Frame(asked.unit, asked.pdu), partial(mbap.encode, asked.transaction)
                for device in devices:
                    for delay, response in device.ask(frame, answering) if device.unit == asked.unit else ():
                        loop.call_later(delay, line.deliver, response)

        line.on_write = answer

    def attach_at_pace(self, port: str, *devices: Device, mode: Mode = "rtu") -> None:
        """Let the program's own simulated devices answer on the line at `port`, each character in its time."""
        memory = self.lines[port]
        line = PacedLine(mode, DEFAULT_FORMATS[mode], devices)
        loop = asyncio.get_running_loop()

        def wake() -> None:
            data = line.tick(loop.time())
            if data:
                memory.deliver(data)
            deadline = line.deadline()
            if deadline is not None:
                timer.set(deadline)

        def written(data: bytes) -> None:
            wake()
            line.written(data, loop.time(), memory.baud or self.opened[port].baud)
            timer.set(line.deadline())

        timer = LazyTimer(loop, wake)
        memory.on_write = written

    def _open(self, settings: PortSettings) -> OpenPort:
        latency = 0.005 if settings.latency is None else settings.latency
        name = settings.port.removeprefix("/dev/")
        self.opened[name] = settings
        has_arrived = (lambda: name not in self.holding_back) if isinstance(settings, TcpSettings) else None
        line = self.lines.setdefault(name, MemoryLine(settings.port, latency, has_arrived=has_arrived))
        return open_to_listen(line.open_port) if getattr(settings, "listens", False) else line.open_port


@asynccontextmanager
async def keep_lines_open(running: Running):
    """Open the port of every line and keep it open; each was tried once on entry. All are closed at the end."""
    async with running.lines_open():
        await running.tried()
        yield


@asynccontextmanager
async def gateway_bench(
    config: str,
    memory: Memory | None = None,
    state: Path | None = None,
    units: Mapping[int, CustomUnit] | None = None,
):
    """A running gateway with this config, every line up and idle. Persistent images need a `state` folder.

    Units made in Python are `units`: virtual time knows no threads.
    """
    with closing(GatewayBench(config, memory, state, units=units)) as bench:
        async with keep_lines_open(bench.running):
            await asyncio.sleep(1.0)
            yield bench
