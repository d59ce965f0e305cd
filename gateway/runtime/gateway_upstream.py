"""One `[[upstream]]` of the config: its units, and the connection to the server that has them."""

import asyncio
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

from gateway.config.plan.forecast import longest_waits_behind
from gateway.config.plan.settings import UpstreamPlan
from gateway.devices.device import Device, SiteDevice
from gateway.events import Emit
from gateway.lines.counts import UnitCounts
from gateway.ports.addresses import Addresses
from gateway.ports.port import SiteSettings
from gateway.ports.reconnector import Reconnector
from gateway.runtime.port_records import kept_in
from gateway.timing.budget import ServerBudget
from gateway.trace.ring import Ring
from gateway.upstreams.driver import TcpDriver
from gateway.upstreams.upstream import Upstream

if TYPE_CHECKING:
    from gateway.fleet.asker import Asker


class GatewayUpstream:
    """An upstream with its parts, with the attributes of a GatewayLine."""

    def __init__(
        self, plan: UpstreamPlan, loop: asyncio.AbstractEventLoop, addresses: Addresses, emit: Emit, ring: Ring
    ) -> None:
        self.plan = plan
        self.now = loop.time
        self.name = plan.upstream.name
        upstream = Upstream(plan.upstream, emit, ring)
        self.driver: TcpDriver | Asker = (
            import_module("gateway.fleet.asker").Asker(upstream, loop, emit)
            if isinstance(plan.port, SiteSettings)
            else TcpDriver(upstream, loop, emit, addresses.next if addresses.are_several else None)
        )
        tell = kept_in(ring, loop.time, emit)
        self.reconnector = Reconnector(self.name, plan.port.port, addresses.open, self.driver, tell, addresses.deadline)

        def use(path: str) -> None:
            self.reconnector.use_path(path)
            upstream.leave_address()

        addresses.moved = use
        kind = SiteDevice if isinstance(plan.port, SiteSettings) else Device
        self._new_device = partial(kind, line=self.driver, emit=emit, ring=ring, line_name=self.name)
        self.devices = {each.known_as: self._new_device(each) for each in plan.devices}
        #: The units that the config does not name, by their numbers there: only the listeners for it lead to them.
        self.unnamed: dict[int, Device] = {}
        self.longest_wait: dict[str, float] = {}
        self.adopt(plan)

    @property
    def all_devices(self) -> tuple[Device, ...]:
        """Its units; of those that the config does not name, the ones that were asked."""
        return (*self.devices.values(), *(device for device in self.unnamed.values() if device.counts))

    @property
    def counts(self) -> tuple[UnitCounts, ...]:
        """The counters of its units."""
        return tuple(device.counts for device in self.all_devices)

    @property
    def sent(self) -> int:
        """The number of requests sent to its units."""
        return sum(counts.sent for unit in self.counts for counts in unit.values())

    def busy(self, now: float) -> float:  # noqa: ARG002 - see GatewayLine
        """Return for how many seconds it was in use: with several requests at once, for the mean of their places."""
        settings, seconds = self.plan.upstream, self.sent * self.plan.upstream.gap
        for unit in self.counts:
            for function, counts in unit.items():
                times = unit.times[function]
                seconds += times.answer.total + (counts.timeout + counts.bad_frame) * times.limit
        return seconds / settings.in_flight

    @property
    def budget(self) -> ServerBudget:
        """What the time limits of its devices are computed with."""
        return self.plan.budget

    def unnamed_of(self, plan: UpstreamPlan) -> dict[int, Device]:
        """Return the units that `plan` does not name: existing ones and new ones."""
        for unit in plan.unlisted:
            if unit not in self.unnamed:
                self.unnamed[unit] = self._new_device(plan.unlisted_unit(unit))
        return {unit: self.unnamed[unit] for unit in plan.unlisted}

    def adopt(self, plan: UpstreamPlan) -> None:
        """Take over `plan`, which differs only in its place in the file or in the listeners that lead to it."""
        self.plan = plan
        self.unnamed = self.unnamed_of(plan)
        self.longest_wait = longest_waits_behind(plan)
        for each in plan.devices:
            self.devices[each.known_as].source = each.source
        for device in self.unnamed.values():
            device.source = plan.upstream.source
