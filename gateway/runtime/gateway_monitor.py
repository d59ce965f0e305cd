"""One monitor line of the config: its port, and the devices that others ask there."""

import asyncio
from collections.abc import Mapping

from gateway.config.plan.forecast import heard_window
from gateway.config.plan.settings import MonitorPlan
from gateway.devices.heard import HeardDevice
from gateway.events import Emit
from gateway.lines.counts import UnitCounts
from gateway.lines.monitor.driver import MonitorDriver
from gateway.lines.monitor.monitor import HeardTransaction, Monitor
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.modbus.pdu import RequestPdu
from gateway.ports.port import Opener
from gateway.ports.reconnector import Reconnector
from gateway.runtime.port_records import kept_in
from gateway.timing.budget import Budget
from gateway.timing.measured import NEVER
from gateway.timing.usage import Usage
from gateway.trace.ring import Ring


class GatewayMonitor:
    """A monitor line with its parts, with the attributes of a GatewayLine."""

    def __init__(
        self, plan: MonitorPlan, loop: asyncio.AbstractEventLoop, opener: Opener, emit: Emit, ring: Ring
    ) -> None:
        self.plan = plan
        self.name = plan.name
        self.now = loop.time
        #: When a request was heard last.
        self.heard_at = NEVER
        #: Nobody waits for its devices.
        self.longest_wait: Mapping[str, float] = {device.name: 0.0 for device in plan.devices}
        self.devices = {each.known_as: HeardDevice(each, emit, ring, self.name) for each in plan.devices}
        self._by_address = {device.settings.unit: device for device in reversed([*self.devices.values()])}
        places = {each.unit: (each.client_unit or each.unit, each.name) for each in reversed(plan.devices)}
        monitor = Monitor(plan.line, self._window, emit, ring, self._heard, places)
        self.driver = MonitorDriver(monitor, loop, emit)
        self.reconnector = Reconnector(
            self.name, plan.port.port, opener(plan.port), self.driver, kept_in(ring, loop.time, emit)
        )

    @property
    def all_devices(self) -> tuple[HeardDevice, ...]:
        """Its units."""
        return tuple(self.devices.values())

    @property
    def counts(self) -> tuple[UnitCounts, ...]:
        """The counters of its units."""
        return tuple(device.counts for device in self.devices.values())

    @property
    def budget(self) -> Budget:
        """What the time limits of its devices are computed with."""
        return self.plan.budget

    @property
    def sent(self) -> int:
        """The number of requests that were heard."""
        return self.driver.monitor.counts.requests

    @property
    def usage(self) -> Usage:
        """The use of the line since the last look at it."""
        return self.driver.monitor.usage

    def busy(self, now: float) -> float:  # noqa: ARG002 - see GatewayLine
        """Return for how many seconds the line was in use."""
        return self.driver.monitor.busy

    def unknown_units(self) -> list[tuple[int, int]]:
        """List units that are asked and not configured, each with the number of requests, the most asked first."""
        asked = self.driver.monitor.counts.requests_to.items()
        unknown = [each for each in asked if each[0] not in self._by_address and each[0] != BROADCAST_UNIT]
        return sorted(unknown, key=lambda each: (-each[1], each[0]))

    def adopt(self, plan: MonitorPlan) -> None:
        """Take over `plan`, which differs only in its place in the file."""
        self.plan = plan
        for each in plan.devices:
            self.devices[each.known_as].source = each.source

    def _heard(self, transaction: HeardTransaction, now: float) -> None:
        """Pass what was heard to its device, a broadcast to all of them."""
        self.heard_at = max(self.heard_at, transaction.asked_at)
        for device in self.devices.values():  # several may be one unit on the wire, under several names
            if transaction.unit in (device.unit, BROADCAST_UNIT):
                device.heard(transaction, now)

    def _window(self, unit: int, asked: RequestPdu) -> float:
        """Return for how many seconds an answer may come."""
        device = self._by_address.get(unit)
        return heard_window(self.plan, None if device is None else device.settings, asked)
