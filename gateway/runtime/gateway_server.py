"""One server line of the config: its port, and the session of the client that asks there."""

import asyncio

from gateway.config.plan.settings import ServerPlan
from gateway.events import Emit
from gateway.listeners.serial import SerialListener
from gateway.ports.port import Opener
from gateway.ports.reconnector import Reconnector
from gateway.routing.access import EntryPoint
from gateway.routing.router import Router
from gateway.runtime.port_records import kept_in
from gateway.trace.ring import Ring


class GatewayServer:
    """A server line with its parts."""

    def __init__(
        self, plan: ServerPlan, loop: asyncio.AbstractEventLoop, opener: Opener, emit: Emit, ring: Ring
    ) -> None:
        self.plan = plan
        self.name = plan.line.name
        self.router = Router(EntryPoint(self.name, "local"), loop.time, emit, ring=ring)
        self.driver = SerialListener(plan.line, self.router, loop, emit, ring)
        tell = kept_in(ring, loop.time, emit)
        self.reconnector = Reconnector(self.name, plan.port.port, opener(plan.port), self.driver, tell)
