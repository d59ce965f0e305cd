"""What the demo prints: requests and responses, hop by hop, in 80 columns."""

import asyncio
import textwrap
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from gateway import events
from gateway.cli.demo.live import Login
from gateway.cli.demo.script import DemoRequest, reading
from gateway.cli.kit.daemon import usual_socket
from gateway.config.plan.settings import Plan
from gateway.config.values.unitset import show_unit
from gateway.lines.line import Line
from gateway.lines.transaction import Transaction
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.modbus.frame import Frame
from gateway.runtime.gateway import Gateway
from gateway.simulator.panel import Panel

#: How long a response may take, in seconds: longer than any limit of the demo.
_PATIENCE: Final = 10.0


@dataclass(frozen=True, slots=True)
class Hop:
    """One transaction on a line: the frames as text, times in milliseconds."""

    line: str
    request: str
    response: str
    elapsed: float
    limit: float


class Stage:
    """A Modbus TCP client that prints what it does. `plan` and `config` are the gateway's."""

    _reader: asyncio.StreamReader
    _writer: asyncio.StreamWriter

    def __init__(self, config: Path, plan: Plan) -> None:
        self._config = config
        self._plan = plan
        self.address = ""
        self._page = ""
        self._hops: list[Hop] = []
        self._told: list[str] = []
        self._names = {device.known_as: device.name for line in plan.lines for device in line.devices}
        self._asked = ""
        self._is_over = False
        self._transaction = 0

    @asynccontextmanager
    async def connected(self, gateway: Gateway) -> AsyncIterator[None]:
        """Connect to `gateway` and observe its lines."""
        self.address = gateway.listeners[0].address
        for part in gateway.lines:
            part.driver.line.observer = partial(self._observe, part.driver.line)
        host, port = self.address.removeprefix("tcp://").split(":")
        self._reader, self._writer = await asyncio.open_connection(host, int(port))
        try:
            yield
        finally:
            self._writer.close()

    def tell(self, event: events.Event) -> None:
        """Take an event of the gateway; it is printed below the request that caused it."""
        if self._is_over:
            return
        if isinstance(event, events.WebUp):
            self._page = event.address
        elif isinstance(event, events.AddressMoved | events.BaudChanged):
            self._told.append(f"{event.name}: {event.advice}")
        elif isinstance(event, events.RequestTimeout | events.BadFrame) and event.device == self._asked:
            self._told.append(f"{event.name}: {event.elapsed_ms:.0f} ms, limit {event.limit_ms:.0f} ms")

    def introduce(self) -> None:
        """Print the address, the lines and the devices."""
        print(f"  clients   {self.address}")
        for line in self._plan.lines:
            timing = line.line.timing
            devices = ", ".join(f"{show_unit(device.client_unit)} {device.name}" for device in line.devices)
            print(f"  {line.line.name:9} {timing.mode.upper():5} {timing.baud:5} {timing.format}   {devices}")
        for server in self._plan.servers:
            timing, units = server.line.timing, ", ".join(map(str, sorted(server.line.serves)))
            print(f"  {server.line.name:9} {timing.mode.upper():5} {timing.baud:5} {timing.format}   client of {units}")
        for image in self._plan.images:
            print(f"  {'(image)':28} {image.unit} {image.name}")
        for unit in self._plan.virtual:
            print(f"  {'(virtual unit)':28} {unit.unit} {unit.name}")
        if self._page:
            print(f"  page      {self._page}")
        print(f"  config    {self._config}")

    async def first(self, question: DemoRequest) -> bool:
        """Send a request, and print every hop."""
        print(f"\nThe first request, hop by hop: {question.about}\n")
        request, answer, right = await self._exchange(question)
        hops = self._hops[-1:]  # none if the machine is so busy that the gateway has refused it
        self._hop("client", "gateway", request.hex(" ").upper())
        for hop in hops:
            self._hop("gateway", hop.line, hop.request)
            self._hop(hop.line, "gateway", hop.response)
        self._hop("gateway", "client", answer.hex(" ").upper())
        value = reading(question.shows, answer[7:])
        for hop in hops:
            print(f"\n  {value}, {hop.elapsed:.1f} ms after the end of the request; time limit {hop.limit:.0f} ms")
        return right

    async def panel_asks(self, panel: Panel, question: DemoRequest) -> bool:
        """Let the HMI on the server line send the same request, and print every hop."""
        print("\nAn old HMI sends the same request over a serial line, in ASCII\n")
        request = Frame(question.unit, bytes.fromhex(question.request))
        self._hops.clear()
        answer = await panel.ask(request, _PATIENCE)
        self._hop("panel", "gateway", _frame("ascii", *request))
        for hop in self._hops:
            self._hop("gateway", hop.line, hop.request)
            self._hop(hop.line, "gateway", hop.response)
        self._hop("gateway", "panel", _frame("ascii", *answer) if answer is not None else "(silence)")
        return answer == Frame(question.unit, bytes.fromhex(question.answer))

    async def ask(self, question: DemoRequest) -> bool:
        """Send a request, and print the frames on the line."""
        _, answer, right = await self._exchange(question)
        mark = "ok " if right else "BAD"
        value = reading(question.shows, answer[7:])
        hops, self._hops = self._hops, []
        times = f"{hops[0].elapsed:.0f} of {hops[0].limit:.0f} ms" if hops else "at once"
        print(f"  {mark} {question.unit:3}  {question.about + ': ' + value:52} {times:>16}")
        for hop in hops:
            print(f"       > {hop.request}\n       < {hop.response}")
        for text in self._told:
            print(f"       ! {text}")
        self._told.clear()
        return right

    async def ask_all_at_once(self) -> bool:
        """Send one segment with a request to every line: the lines work independently."""
        units = [
            device.known_as for line in self._plan.lines for device in line.shared if device.client_unit is not None
        ]
        units += [image.unit for image in self._plan.images]
        units += [unit.unit for unit in self._plan.virtual]
        print("\nOne TCP segment with a request to each unit; responses in order of arrival\n")
        self._writer.write(b"".join(mbap.encode(unit, unit, bytes.fromhex("03 00 01 00 01")) for unit in units))
        answered = []
        for _ in units:
            header = await asyncio.wait_for(self._reader.readexactly(6), _PATIENCE)
            adu = header + await self._reader.readexactly(int.from_bytes(header[4:]))
            answered.append(adu[6])
        print(_list("  requests  ", units))
        print(_list("  responses ", answered))
        self._hops.clear()
        return sorted(answered) == sorted(units)

    def invite(self, control: Path, login: Login | None) -> None:
        """Print what to try next; `control` is the gateway's control socket, `login` the user of its page."""
        port = self.address.rsplit(":", 1)[1]
        mbpoll = f"mbpoll -p {port}"
        self._is_over = True
        usual = control == usual_socket()
        command = "./deploy/go" if (Path.cwd() / "deploy" / "go").exists() else "modbus-gateway"
        at = "" if usual else f" --control {control}"
        if self._page and login is not None:
            print(f"\nSome clients keep the lines busy. See them in a browser: {self._page}")
            print(f"To write registers there, log in: {login.user}, password {login.password}")
            print("(made for this run). What it shows of the time before the demo is made up.")
        print("\nThe lines keep running. In another terminal, for example:\n")
        print(f"  {command} read silo-1{at}")
        print(f"  {command} read plant{at}")
        print(f"  {command} read press holding 107-109{at}")
        print(f"  {command} write oven register-40136 926 --show{at}")
        print(f"  {command} trace{at}")
        print(f"  {mbpoll} -a 41 -t 4:float -B -0 -r 0 -1 127.0.0.1 # silo-1: weight")
        print(f"  {mbpoll} -a 46 -t 4 -0 -r 107 -c 3 -1 127.0.0.1   # press: 40108-40110")
        print(f"  {mbpoll} -a 52 -t 4 -0 -r 30 127.0.0.1 1234 5678  # axis-1: Comms 30-31")
        print("\nCtrl-C ends everything.", flush=True)

    async def _exchange(self, question: DemoRequest) -> tuple[bytes, bytes, bool]:
        """Return request and response as TCP ADUs, and whether both are right, on the line too."""
        self._transaction += 1
        request = mbap.encode(self._transaction, question.unit, bytes.fromhex(question.request))
        self._hops.clear()
        self._asked = self._names.get(question.unit, "")
        self._writer.write(request)
        header = await asyncio.wait_for(self._reader.readexactly(6), _PATIENCE)
        answer = header + await asyncio.wait_for(self._reader.readexactly(int.from_bytes(header[4:])), _PATIENCE)
        right = answer == mbap.encode(self._transaction, question.unit, bytes.fromhex(question.answer))
        if question.printed is not None:
            right = right and question.printed == (self._hops[-1].request, self._hops[-1].response)
        return request, answer, right

    def _observe(self, line: Line, transaction: Transaction, response: Frame | None, now: float) -> None:
        is_poll = transaction.yields and len(transaction.requests) == 1
        if self._is_over or is_poll:
            return
        mode = line.settings.timing.mode
        self._hops.append(
            Hop(
                line=line.settings.name,
                request=_frame(mode, transaction.unit, transaction.asked.data),
                response=_frame(mode, *response) if response is not None else "(silence)",
                elapsed=1000 * (now - transaction.ends_at),
                limit=1000 * transaction.limit,
            )
        )

    def _hop(self, source: str, target: str, text: str) -> None:
        print(f"  {source:>7} > {target:8} {text}")


def _list(heading: str, units: Sequence[int]) -> str:
    return textwrap.fill(", ".join(map(str, units)), 80, initial_indent=heading, subsequent_indent=" " * len(heading))


def _frame(mode: str, unit: int, pdu: bytes) -> str:
    """Show a frame as documents print it: hexadecimal bytes in RTU, characters in ASCII."""
    if mode == "ascii":
        return ascii_framing.encode(unit, pdu).decode().strip()
    return rtu.encode(unit, pdu).hex(" ").upper()
