"""An upstream on a table: the other server's bytes, the clock and the events in the test's hands."""

from typing import NamedTuple, TypeVar

from gateway.devices.device import Device, DeviceSettings
from gateway.events import Event
from gateway.lines.counts import Counts, total
from gateway.lines.transaction import Transaction
from gateway.modbus.mbap import MbapFramer, encode
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from gateway.upstreams.settings import UpstreamSettings
from gateway.upstreams.upstream import Upstream
from kit.asker import Asker

READ = "03 00 10 00 01"
RESPONSE = "03 02 01 10"
WRITE = "06 00 01 00 05"
TIMEOUT = 0.5

E = TypeVar("E", bound=Event)


class Sent(NamedTuple):
    """A request that the other server got."""

    transaction: int
    unit: int
    pdu: str


class UpstreamBench:
    """An Upstream that is connected. Unit 37 of clients is unit 7 behind it, 38 is 8, and so on.

    Its units have this `timeout`, and sleep after `wake` seconds.
    """

    def __init__(self, timeout: float = TIMEOUT, wake: float = 0.0, **settings: object) -> None:
        self.timeout = timeout
        self.wake = wake
        self.settings = UpstreamSettings("plant-1", **settings)
        self.events: list[Event] = []
        self.upstream = Upstream(self.settings, self.events.append)
        self.sent: list[Sent] = []
        self.now = 100.0
        self.client = Asker()
        #: How often another connection was ordered.
        self.orders = 0
        self._devices: dict[int, Device] = {}
        self.connect()

    def connect(self) -> None:
        self._framer = MbapFramer(strict=True)
        self.upstream.port_up(self._send, self.now)
        self.upstream.tick(self.now)

    def hang_up(self, *, at_once: bool = False) -> bool:
        """The other server closes the connection in order; whether that is no loss."""
        self.upstream.port_ended(self._open, self.now, at_once=at_once)
        if not self.upstream.is_closed:
            self.upstream.port_down(self.now)
        return self.upstream.is_closed

    def device(self, unit: int) -> Device:
        return self._devices[unit] if unit in self._devices else self.add_device(unit, unit - 30)

    def add_device(self, known_as: int, unit: int) -> Device:
        """A new device: `unit` behind the server, `known_as` for clients."""
        answer_time = AnswerTime(TimingTable(), margin=1.0, timeout=self.timeout, fixed=True)
        settings = DeviceSettings(
            f"plant-1/{known_as}", unit, known_as, Profile("upstream"), answer_time, wake=self.wake
        )
        self._devices[known_as] = Device(settings, self.upstream)
        return self._devices[known_as]

    @property
    def counts(self) -> Counts:
        """Those of all units."""
        return total(counts for device in self._devices.values() for counts in device.counts.values())

    def ask(self, pdu: str = READ, unit: int = 37, client: Asker | None = None, *, in_one_turn: int = 0) -> None:
        request = (client or self.client).ask(pdu, unit=unit, now=self.now)
        request.in_one_turn = in_one_turn
        self.device(unit).submit(request, self.now)

    def hear(self, data: bytes) -> None:
        """The other server says this."""
        self.upstream.received(self._framer.cut(data), self.now)

    def respond(self, pdu: str = RESPONSE, to: int = -1, unit: int | None = None) -> None:
        """It answers one of the requests `sent`; with `unit` from another one than it was asked."""
        request = self.sent[to]
        self.hear(encode(request.transaction, request.unit if unit is None else unit, bytes.fromhex(pdu)))

    def pass_time(self, seconds: float) -> None:
        """Let time pass as the driver does: the upstream is woken at each of its deadlines."""
        end = self.now + seconds
        while (deadline := self.upstream.deadline()) is not None and deadline <= end:
            self.now = max(deadline, self.now)
            self.upstream.tick(self.now)
        self.now = end

    def told(self, kind: type[E]) -> list[E]:
        """The events of this kind."""
        return [event for event in self.events if isinstance(event, kind)]

    def _open(self) -> None:
        self.orders += 1

    def _send(self, identifier: int, transaction: Transaction) -> None:
        self.sent.append(Sent(identifier, transaction.unit, transaction.asked.data.hex(" ").upper()))
