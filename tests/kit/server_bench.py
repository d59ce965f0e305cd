"""A line on which we are a server, on a table: its bytes, its clock, its router and its events in the test's hands."""

from dataclasses import replace
from typing import TypeVar

from gateway.events import Event
from gateway.listeners.sessions.server_line import SerialSession, ServerSettings
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.request import Request, Target
from gateway.timing.characters import CharacterFormat, LineTiming

RTU = LineTiming("rtu", 19200, CharacterFormat.parse("8E1"))
ASCII = LineTiming("ascii", 19200, CharacterFormat.parse("7E1"))
LATENCY = 0.005

E = TypeVar("E", bound=Event)


class ServerBench(Target):
    """A session that serves units 41 and 42, its port open and quiet. `asked` are the requests that it has handed on.

    `at_once` is what they are answered with, if anything.
    """

    def __init__(self, timing: LineTiming = RTU, *, virtual: bool = True, **settings: object) -> None:
        self.settings = replace(ServerSettings("panel", timing, frozenset({41, 42}), source="a.toml:7"), **settings)
        self.virtual = virtual
        self.now = 100.0
        self.events: list[Event] = []
        self.asked: list[Request] = []
        self.at_once: bytes | None = None
        self._written: list[tuple[float, bytes]] = []
        self.session = SerialSession(self.settings, self, lambda: None, self.events.append)
        self.counts = self.session.counts
        self.plug()
        self.pass_time(1.0)

    def submit(self, request: Request, now: float) -> None:
        self.asked.append(request)
        if self.at_once is not None:
            request.respond(self.at_once)

    def plug(self) -> None:
        self.session.port_up(self._write, LATENCY, self.now, virtual=self.virtual)

    def frame(self, unit: int, pdu: str) -> bytes:
        """As it goes on this line."""
        encode = ascii_framing.encode if self.settings.timing.mode == "ascii" else rtu.encode
        return encode(unit, bytes.fromhex(pdu))

    def hear(self, data: bytes) -> None:
        self.session.received(data, self.now)

    def ask(self, pdu: str, unit: int = 41) -> Request | None:
        """The client sends this; the request that came of it, if one did."""
        count = len(self.asked)
        self.hear(self.frame(unit, pdu))
        return self.asked[-1] if len(self.asked) > count else None

    def take_written(self) -> list[bytes]:
        """What was put on the line since the last call; what is due now is put there first."""
        self.pass_time(0.0)
        written = [data for _, data in self._written]
        self._written.clear()
        return written

    @property
    def last_written_at(self) -> float:
        return self._written[-1][0]

    def pass_time(self, seconds: float) -> None:
        """Let time pass as the driver does: the session is woken at each of its deadlines."""
        end = self.now + seconds
        while (deadline := self.session.deadline()) is not None and deadline <= end:
            self.now = max(deadline, self.now)
            self.session.tick(self.now)
            assert self.session.deadline() != deadline, "the same deadline again: the loop would be busy"
        self.now = end

    def told(self, kind: type[E]) -> list[E]:
        """The events of this kind."""
        return [event for event in self.events if isinstance(event, kind)]

    def _write(self, data: bytes) -> None:
        self._written.append((self.now, data))
