"""A line on a table: its bytes, its clock and its events in the test's hands."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from gateway.devices.device import Device, DeviceSettings, EveryDevice
from gateway.events import Event
from gateway.lines.counts import Counts, total
from gateway.lines.line import Line
from gateway.lines.settings import LineSettings
from gateway.modbus import ascii as ascii_framing
from gateway.modbus.rtu import encode
from gateway.profiles.profile import Profile
from gateway.runtime.overdue import as_entry, read_entry
from gateway.timing.budget import AnswerTime
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.timing.table import TimingTable
from gateway.trace.ring import Ring
from kit.asker import Asker

TIMING = LineTiming("rtu", 19200, CharacterFormat.parse("8E1"))
ASCII = LineTiming("ascii", 9600, CharacterFormat.parse("7E1"))
SETTINGS = LineSettings("hall-a", TIMING, turnaround=0.1)
LATENCY = 0.005

READ = "03 00 10 00 01"
READ_FRAME = "01 03 00 10 00 01 85 CF"
RESPONSE = "03 02 01 10"
RESPONSE_FRAME = "01 03 02 01 10 B8 18"
#: The request's time on the wire, and the limit of a device's time-out, for READ.
REQUEST_TIME = 8 * TIMING.character
LIMIT = 0.2 + 7 * TIMING.character + LATENCY

E = TypeVar("E", bound=Event)


class Bench:
    """A Line with devices that have a time-out of 200 ms, its port open and quiet. `virtual` is the port's.

    A `connection` has what is written arrive at the other end, as long as `arrives` is true.
    """

    def __init__(
        self, *, virtual: bool = True, connection: bool = False, ring: Ring | None = None, **settings: object
    ) -> None:
        self.settings = replace(SETTINGS, **settings)
        self.virtual = virtual
        self.has_arrived = (lambda: self.arrives) if connection else None
        self.arrives = True
        self.has_lease = True
        self.askers = 0
        self.events: list[Event] = []
        self.line = Line(self.settings, self.events.append, ring)
        self.devices: dict[int, Device] = {}
        self.everyone = EveryDevice(self.line)
        self.written: list[str] = []
        self.now = 100.0
        self.client = Asker()
        self.plug()
        self.pass_time(1.0)

    def plug(self) -> None:
        self.line.port_up(self._write, LATENCY, self.now, virtual=self.virtual, has_arrived=self.has_arrived)

    def unplug(self) -> None:
        self.line.port_down(self.now)

    def share(self) -> None:
        """Let others ask here in turn: nothing is sent without the lease. `askers` counts who was told of."""
        self.line.share(lambda: self.has_lease, self._heard_asker)

    def take_over(self, before: "Bench", *, by_file: bool = False, patience: float = 1.0) -> None:
        """Follow another line on the same port, as after a reload, or, `by_file`, after a restart.

        Nobody on the line is answered later than `patience` seconds after it has asked.
        """
        self.now = before.now
        self.plug()
        overdue = before.line.ledger.handed_on(self.now, patience)
        if by_file:
            overdue = read_entry(json.loads(json.dumps(as_entry(overdue, self.now))), self.now, 0.0)
        self.line.ledger.take_over(overdue, patience)

    def device(
        self,
        unit: int = 1,
        profile: Profile | None = None,
        timeout: float = 0.2,
        *,
        urgent: bool = False,
        wake: float = 0.0,
    ) -> Device:
        """A new device; the bench's requests to `unit` go to it from now on."""
        answer_time = AnswerTime(TimingTable(), margin=1.5, timeout=timeout)
        priority = "high" if urgent else "normal"
        profile = profile or Profile("generic")
        settings = DeviceSettings(f"unit-{unit}", unit, unit, profile, answer_time, priority, wake)
        self.devices[unit] = Device(settings, self.line)
        return self.devices[unit]

    def ask(self, pdu: str = READ, unit: int = 1, client: Asker | None = None, *, in_one_turn: int = 0) -> None:
        asker = client or self.client
        device = self.devices.get(unit) or self.device(unit)
        request = asker.ask(pdu, unit=unit, now=self.now)
        request.in_one_turn = in_one_turn
        device.submit(request, self.now)

    def asks(self, pdu: str = READ, unit: int = 1) -> str | None:
        """Ask, wait for the answer."""
        count = len(self.client.answers)
        self.ask(pdu, unit)
        self.pass_time(1.0)
        (answer,) = self.client.answers[count:]
        return answer

    def broadcast(self, pdu: str, client: Asker | None = None) -> None:
        self.everyone.submit((client or self.client).ask(pdu, unit=0, now=self.now), self.now)

    def hear(self, frame: str) -> None:
        self.line.received(bytes.fromhex(frame), self.now)

    def respond(self, pdu: str = RESPONSE, unit: int = 1) -> None:
        """A device says this."""
        self.hear(self.frame(unit, pdu))

    def frame(self, unit: int, pdu: str) -> str:
        """As it goes on this line."""
        return frame(unit, pdu, ascii_framing.encode if self.settings.timing.mode == "ascii" else encode)

    def pass_time(self, seconds: float) -> None:
        """Let time pass as the driver does: the line is woken at each of its deadlines.

        It is left alone once it needs a new connection.
        """
        end = self.now + seconds
        while (deadline := self.line.deadline()) is not None and deadline <= end:
            self.now = max(deadline, self.now)
            self.tick()
            if self.line.must_renew(self.now):
                break
        self.now = end

    def tick(self) -> None:
        """Wake the line; it closes a connection that nobody has used for so long."""
        self.line.tick(self.now)
        if self.line.may_leave(self.now) and not self.line.must_renew(self.now):
            self.line.renew(self.now)

    @property
    def counts(self) -> Counts:
        """All that the devices have counted, and the line for its broadcasts."""
        devices = [*self.devices.values(), self.everyone]
        return total(counts for device in devices for counts in device.counts.values())

    def told(self, kind: type[E]) -> list[E]:
        """The events of this kind."""
        return [event for event in self.events if isinstance(event, kind)]

    def _heard_asker(self) -> None:
        self.askers += 1

    def _write(self, data: bytes) -> None:
        self.written.append(data.hex(" ").upper())


def frame(unit: int, pdu: str, encoder: Callable[[int, bytes], bytes] = encode) -> str:
    return encoder(unit, bytes.fromhex(pdu)).hex(" ").upper()


def is_empty(line: Line) -> bool:
    """Whether nothing is left behind in a line: no transaction, no window, nothing that waits."""
    queue = line.queue
    left = (len(queue), queue._reads, queue.has_expiry, queue._given_up, queue._repeats)
    return not any(left) and line.ledger.current is None
