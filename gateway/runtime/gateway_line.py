"""One client line of the config: its devices, its scheduler and its port. A reload keeps or replaces all of it."""

import asyncio
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from importlib import import_module
from math import ceil
from typing import TYPE_CHECKING

from gateway.config.plan.forecast import longest_waits
from gateway.config.plan.settings import LinePlan
from gateway.devices.addresses import UnitAddresses
from gateway.devices.device import Device, DeviceSettings, EveryDevice
from gateway.devices.quirks import AddressZeroDevice, EveryQuirkyDevice, MovableDevice
from gateway.errors import WrongQuestion
from gateway.events import Emit, discard_event
from gateway.lines.counts import UnitCounts
from gateway.lines.driver import LineDriver
from gateway.lines.exchange import Exchange
from gateway.lines.line import Line
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.ports.port import Opener, Port, PortUser, SerialSettings
from gateway.ports.reconnector import OPENING_DEADLINE, Reconnector
from gateway.runtime import remembered
from gateway.runtime.port_records import kept_in
from gateway.state.memory import Memory
from gateway.timing.budget import Budget
from gateway.timing.characters import CharacterFormat
from gateway.timing.usage import Usage
from gateway.trace.ring import Ring

if TYPE_CHECKING:
    from gateway.fleet.standby import Standby
    from gateway.runtime.fleet.shared_line import Buckets


class GatewayLine:
    """A client line with its parts. `devices` is by the unit for clients, `longest_wait` by name, in seconds.

    `opener` opens ports. `buckets` is where its lease is kept, if the plan names one.
    """

    def __init__(
        self,
        plan: LinePlan,
        loop: asyncio.AbstractEventLoop,
        opener: Opener,
        memory: Memory,
        emit: Emit,
        ring: Ring,
        buckets: "Buckets | None" = None,
    ) -> None:
        self.plan = plan
        #: Whether a scan goes on.
        self.is_scanned = False
        self._least_patience = 0.0
        self._loop = loop
        self._memory = memory
        self._emit = emit
        self._ring = ring
        self._addresses = UnitAddresses()
        self.name = name = plan.line.name
        timing = plan.line.timing
        self.opener = opener
        settings = replace(plan.line, timing=replace(timing, baud=remembered.rate(plan, memory)))
        #: Holds the lease of the line, if it has one.
        self.standby = None if plan.lease is None or buckets is None else self._standby(plan, buckets)
        self.driver = LineDriver(
            Line(settings, emit, ring),
            loop,
            emit,
            self._remember_rate,
            self.standby,
            reads_at_once=isinstance(plan.port, SerialSettings),
        )
        self.reconnector = Reconnector(
            name,
            plan.port.port,
            self._open,
            self.driver,
            kept_in(ring, loop.time, emit),
            OPENING_DEADLINE + plan.line.after_connect,
        )
        self.every_device = self._every_device(plan)
        self.devices: dict[int, Device] = {}
        self.longest_wait: dict[str, float] = {}
        self.adopt(plan, self.devices_of(plan))

    def at_speed(self, baud: int, format_: CharacterFormat | None = None) -> "GatewayLine":
        """Make a line on the same port, at another rate or format, without devices and without memory."""
        plan, port = self.plan, self.plan.port
        format_ = format_ or plan.line.timing.format
        if isinstance(port, SerialSettings):
            port = replace(port, baud=baud, format=format_)
        line = replace(plan.line, timing=replace(plan.line.timing, baud=baud, format=format_))
        plan = replace(plan, port=port, line=line, devices=(), passes_through=False, lease=None)
        there = GatewayLine(plan, self._loop, self.opener, Memory(), discard_event, Ring())
        there._least_patience = self.patience
        return there

    async def run(self) -> None:
        """Keep the port open until cancelled, as long as the line may ask."""
        await (self.reconnector.run() if self.standby is None else self.standby.run())

    @property
    def is_standby(self) -> bool:
        """Whether another gateway may ask there, and not this one."""
        return self.standby is not None and not self.standby.lease.is_held

    def now(self) -> float:
        """Return the time of the line's clock, in seconds."""
        return self._loop.time()

    def means(self, plan: LinePlan) -> bool:
        """Return whether `plan` is for the same line. The passed-through units may differ."""
        return self.plan.meaning == plan.meaning

    @property
    def counts(self) -> tuple[UnitCounts, ...]:
        """The counters of its units and of its broadcasts."""
        return (self.every_device.counts, *(device.counts for device in self.devices.values()))

    @property
    def all_devices(self) -> tuple[Device, ...]:
        """Its units."""
        return tuple(self.devices.values())

    @property
    def budget(self) -> Budget:
        """What the time limits of its devices are computed with, at its present rate."""
        return Budget(self.driver.line.settings.timing, self.plan.latency)

    @property
    def sent(self) -> int:
        """The number of frames sent to its units, and as broadcasts."""
        return sum(counts.sent for unit in self.counts for counts in unit.values())

    @property
    def usage(self) -> Usage:
        """The use of the line since the last look at it."""
        return self.driver.line.spent.usage

    def busy(self, now: float) -> float:
        """Return for how many seconds the line was in use."""
        return self.driver.line.phases(now).busy

    @property
    def patience(self) -> float:
        """The longest time from a request to its response, late ones included, in seconds."""
        line = self.plan.line
        limit = max(self.longest_wait.values(), default=line.max_wait) - line.max_wait
        slowest = max((device.answer_time.slowest for device in self.plan.devices), default=0.0)
        late = max(2 * limit, slowest) if line.late_window is None else line.late_window
        return max(limit + late, self._least_patience)

    def handed_on(self, now: float) -> list[Exchange]:
        """List what may still arrive on the port, for the next line there: see Ledger."""
        return self.driver.line.ledger.handed_on(now, self.patience)

    def take_over(self, exchanges: Iterable[Exchange]) -> None:
        """Expect what may still arrive on the port from a line before on it: see Ledger."""
        self.driver.line.ledger.take_over(exchanges, self.patience)

    def begin(self) -> None:
        """Take addresses and rate from memory: the previous line on this port may have changed them just now."""
        plan, memory = self.plan, self._memory
        memory.expect(remembered.rate_key(plan), plan.line.timing.baud)
        for each in plan.devices:
            memory.expect(remembered.address_key(plan, each), each.unit)
        self.place_devices()
        rate = remembered.rate(plan, memory)
        if rate != self.driver.line.settings.timing.baud:
            self.driver.change_rate(rate)

    def place_devices(self) -> None:
        """Set all devices to their remembered addresses."""
        addresses = remembered.addresses(self.plan, self._memory)
        for device in self.devices.values():
            if isinstance(device, MovableDevice):
                device.begin_at(*addresses[device.name])

    def forget(self, device: Device) -> None:
        """Set a device to the configured address, and the line to the configured rate.

        Raises:
            WrongQuestion: another gateway has the line now, another device has that address, or this one may be about
                to change its own.
        """
        settings, baud = device.settings, self.plan.line.timing.baud
        if self.is_standby:
            raise WrongQuestion(f"another gateway has the lease of {self.name}: tell that one to forget")
        wait = self.driver.line.ledger.changes_until(device.possible_units) - self.now()
        if wait > 0.0:
            raise WrongQuestion(
                f"{settings.name} was sent a change of its address, and may act on it yet: try again in {ceil(wait)} s"
            )
        is_free = self._addresses.is_free(settings.unit, settings.name)
        if not is_free or remembered.rivals(self.plan, settings, self._memory, settings.unit):
            raise WrongQuestion(
                f"another device of {self.name} has, or may have, the address {settings.unit}: forget that one first, "
                f"or give {settings.name} another unit in {device.source}"
            )
        remembered.forget(self.plan, self._memory, settings)
        self.place_devices()
        if baud != self.driver.line.settings.timing.baud:
            self.driver.change_rate(baud)

    def devices_of(self, plan: LinePlan) -> dict[int, Device]:
        """Return the devices of `plan`: existing ones and new ones."""
        return {each.known_as: self.devices.get(each.known_as) or self._device(each) for each in plan.devices}

    def adopt(self, plan: LinePlan, devices: dict[int, Device]) -> None:
        """Take over `plan`, which differs only in its place in the file or in passed-through units."""
        self.plan = plan
        self.devices = devices
        self.every_device.devices = devices.values()
        self.longest_wait = longest_waits(plan)
        for each in plan.devices:
            devices[each.known_as].source = each.source
        self.place_devices()

    def _remember_rate(self, baud: int) -> None:
        """Remember that the line has changed its rate: the next run finds its devices there."""
        self._memory.remember(remembered.rate_key(self.plan), self.plan.line.timing.baud, baud)

    async def _open(self, user: PortUser) -> Port:
        """Open the port at the rate that the line has changed to, if any; a device server keeps its rate."""
        settings = self.plan.port
        if isinstance(settings, SerialSettings):
            settings = replace(settings, baud=remembered.rate(self.plan, self._memory))
        return await self.opener(settings)(user)

    def _standby(self, plan: LinePlan, buckets: "Buckets") -> "Standby":
        """Make the Standby that keeps the port open while the lease is held. Its code is loaded only for that."""
        standby: Standby = import_module("gateway.runtime.fleet.shared_line").standby_for(
            self, plan, self._memory, buckets, self._emit
        )
        return standby

    def _every_device(self, plan: LinePlan) -> EveryDevice:
        quirks = frozenset[str]().union(*(each.profile.quirks for each in plan.devices))
        if not quirks:
            return EveryDevice(self.driver, self._emit, self._ring, self.name)
        return EveryQuirkyDevice(self.driver, quirks, self._emit, self._ring, self.name)

    def _device(self, settings: DeviceSettings) -> Device:
        if settings.unit == BROADCAST_UNIT:
            return AddressZeroDevice(settings, self.driver, self._emit, self._ring, self.name)
        if not settings.profile.quirks:
            self._addresses.place(settings.name, settings.unit)
            return Device(settings, self.driver, self._emit, self._ring, self.name)
        return self._restless_device(settings)

    def _restless_device(self, settings: DeviceSettings) -> Device:
        line, key = self.plan.line, remembered.address_key(self.plan, settings)
        return MovableDevice(
            settings,
            self.driver,
            line_name=line.name,
            line_source=line.source,
            addresses=self._addresses,
            change_rate=self.driver.change_rate if len(self.plan.devices) == 1 else None,
            remember=partial(self._memory.remember, key, settings.unit),
            emit=self._emit,
            ring=self._ring,
        )
