"""The state of a line that moves to the next holder of its lease."""

from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from functools import partial
from math import inf
from socket import gethostname
from typing import TYPE_CHECKING, Any, Final, Protocol

from gateway.config.plan.forecast import guard, longest_late_window
from gateway.config.plan.settings import LinePlan
from gateway.devices.quirks import BAUD_RATES
from gateway.errors import PortError
from gateway.events import Emit
from gateway.fleet.lease import LeaseSettings
from gateway.fleet.standby import Standby
from gateway.fleet.subjects import LEASES
from gateway.lines.driver import LineDriver
from gateway.lines.exchange import Exchange
from gateway.ports.port import TcpSettings
from gateway.ports.reconnector import Reconnector
from gateway.runtime import remembered
from gateway.runtime.overdue import as_entry, is_entry, read_entry
from gateway.state.memory import Memory

if TYPE_CHECKING:
    from gateway.fleet.bucket import Bucket

#: Stands for the rate among names of devices, none of which can be empty.
_RATE: Final = ""

#: Opens the bucket of a name. Raises FleetError if NATS cannot be reached.
Buckets = Callable[[str], Awaitable["Bucket"]]


class OwnLine(Protocol):
    """What is needed of a line of this gateway; see GatewayLine."""

    name: str
    plan: LinePlan
    driver: LineDriver
    reconnector: Reconnector

    def now(self) -> float:
        """Return the time of the line's clock, in seconds."""

    def place_devices(self) -> None:
        """Set all devices to their remembered addresses."""

    def handed_on(self, now: float) -> list[Exchange]:
        """List what may still arrive on the port."""

    def take_over(self, exchanges: Iterable[Exchange]) -> None:
        """Expect what may still arrive on the port."""


def standby_for(line: OwnLine, plan: LinePlan, memory: Memory, buckets: Buckets, emit: Emit) -> Standby:
    """Make the Standby that keeps the port of `line` open while this gateway holds the lease of its plan."""
    lease = plan.lease
    assert lease is not None  # noqa: S101 - for lines with a lease
    settings = LeaseSettings(lease.name, lease.ttl, guard(plan), longest_late_window(plan), lease.fallback)
    holder = f"{lease.site} at {gethostname()}"
    return Standby(line.name, settings, holder, partial(buckets, LEASES), SharedPort(line, memory), emit)


class SharedPort:
    """The port and the state of `line`, as its Standby sees them."""

    def __init__(self, line: OwnLine, memory: Memory) -> None:
        self._line = line
        self._memory = memory
        #: Names of devices that have moved, and _RATE: once there, they are reported even if the config is right again.
        self._changed: set[str] = set()

    @property
    def is_usable(self) -> bool:
        """See SharedLine."""
        return self._line.reconnector.error is None

    async def keep_open(self) -> None:
        """See SharedLine."""
        self._line.reconnector.begin_anew()
        await self._line.reconnector.run()

    def withhold(self, reason: PortError) -> None:
        """See SharedLine."""
        self._line.reconnector.withhold(reason)

    def state(self) -> dict[str, Any]:
        """Return the addresses of devices that have moved, and a changed rate, each after the configured value."""
        plan = self._line.plan
        at = {each.name: remembered.recall(plan, each, self._memory) for each in plan.devices}
        self._changed |= {each.name for each in plan.devices if at[each.name] != (each.unit,)}
        addresses = {each.name: [each.unit, *at[each.name]] for each in plan.devices if each.name in self._changed}
        state: dict[str, Any] = {"addresses": addresses} if addresses else {}
        rate, configured = remembered.rate(plan, self._memory), plan.line.timing.baud
        self._changed |= {_RATE} if rate != configured else set()
        return state | ({"rate": [configured, rate]} if _RATE in self._changed else {})

    def final_state(self) -> dict[str, Any]:
        """Return the state with what may still arrive on the port; its times count from now on."""
        now = self._line.now()
        late = self._line.handed_on(now)
        return self.state() | ({"late": as_entry(late, now, -now)} if late else {})

    def adopt(self, state: Mapping[str, Any]) -> None:
        """Take over the state of the previous holder; ignore entries that do not match the config."""
        self._adopt_addresses(dict(_changes(state.get("addresses"))))
        rate = _change(state.get("rate"))
        if rate is not None:
            self._adopt_rate(*rate[:2])
        late = state.get("late")
        if late is not None and is_entry(late):
            self._line.take_over(read_entry(late, -inf, self._line.now()))

    def _adopt_addresses(self, moved: Mapping[str, tuple[int, ...]]) -> None:
        plan = self._line.plan
        for each in plan.devices:
            configured, *units = moved.get(each.name, (0, 0))
            if configured == each.unit and all(remembered.is_possible(each, unit) for unit in units):
                self._changed.add(each.name)
                self._memory.remember(remembered.address_key(plan, each), each.unit, *units)
        self._line.place_devices()

    def _adopt_rate(self, configured: int, rate: int) -> None:
        plan = self._line.plan
        if configured != plan.line.timing.baud or rate not in BAUD_RATES or isinstance(plan.port, TcpSettings):
            return
        self._changed.add(_RATE)
        if rate != remembered.rate(plan, self._memory):
            self._line.driver.change_rate(rate)


def _changes(value: object) -> Iterator[tuple[str, tuple[int, ...]]]:
    for name, values in value.items() if isinstance(value, dict) else ():
        change = _change(values)
        if isinstance(name, str) and change is not None:
            yield name, change


def _change(values: object) -> tuple[int, ...] | None:
    """Read the value in the previous holder's config, the present one, and other possible ones; None if malformed."""
    if isinstance(values, list) and len(values) > 1 and all(isinstance(each, int) for each in values):
        return tuple(values)
    return None
