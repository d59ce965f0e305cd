"""A line on a table: its bytes, its clock and its events in the test's hands."""

from collections.abc import Callable
from dataclasses import replace

from gateway.events import Event
from gateway.lines.device import Device, DeviceSettings, EveryDevice
from gateway.lines.line import Line, LineSettings
from gateway.modbus.chartime import CharacterFormat, LineTiming
from gateway.modbus.rtu import encode
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from kit.asker import Asker

TIMING = LineTiming("rtu", 19200, CharacterFormat.parse("8E1"))
SETTINGS = LineSettings("hall-a", TIMING, turnaround=0.1)
LATENCY = 0.005

READ = "03 00 10 00 01"
READ_FRAME = "01 03 00 10 00 01 85 CF"
RESPONSE = "03 02 01 10"
RESPONSE_FRAME = "01 03 02 01 10 B8 18"


class Bench:
    """A Line with one device of unit 1 and a time-out of 200 ms, its port open and quiet."""

    def __init__(self, **settings: object) -> None:
        self.settings = replace(SETTINGS, **settings)
        self.events: list[Event] = []
        self.line = Line(self.settings, self.events.append)
        self.written: list[str] = []
        self.now = 100.0
        self.client = Asker()
        self.plug()
        self.pass_time(1.0)

    def plug(self) -> None:
        self.line.port_up(self._write, LATENCY, self.now)

    def device(self, unit: int = 1, profile: Profile | None = None, timeout: float = 0.2) -> Device:
        answer_time = AnswerTime(TimingTable(), margin=1.5, timeout=timeout)
        settings = DeviceSettings(f"unit-{unit}", unit, unit, profile or Profile("generic"), answer_time)
        return Device(settings, self.line)

    def ask(self, pdu: str = READ, unit: int = 1, client: Asker | None = None) -> None:
        asker = client or self.client
        self.device(unit).submit(asker.ask(pdu, unit=unit, now=self.now), self.now)

    def broadcast(self, pdu: str) -> None:
        EveryDevice(self.line).submit(self.client.ask(pdu, unit=0, now=self.now), self.now)

    def hear(self, frame: str) -> None:
        self.line.received(bytes.fromhex(frame), self.now)

    def pass_time(self, seconds: float) -> None:
        """Let time pass as the driver does: the line is woken at each of its deadlines."""
        end = self.now + seconds
        while (deadline := self.line.deadline()) is not None and deadline <= end:
            self.now = max(deadline, self.now)
            self.line.tick(self.now)
        self.now = end

    def _write(self, data: bytes) -> None:
        self.written.append(data.hex(" ").upper())


def frame(unit: int, pdu: str, encoder: Callable[[int, bytes], bytes] = encode) -> str:
    return encoder(unit, bytes.fromhex(pdu)).hex(" ").upper()
