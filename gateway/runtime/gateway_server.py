"""One server line of the config: its port, and the session of the client that asks there."""

import asyncio
from dataclasses import replace

from gateway.config.plan.settings import ServerPlan
from gateway.events import Emit
from gateway.listeners.programs import ProgramListener
from gateway.listeners.serial import SerialListener
from gateway.ports.port import Opener, PtySettings
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
        listener = ProgramListener if isinstance(plan.port, PtySettings) else SerialListener
        self.driver: ProgramListener | SerialListener = listener(plan.line, self.router, loop, emit, ring)
        tell = kept_in(ring, loop.time, emit)
        self.reconnector = Reconnector(self.name, plan.port.port, opener(plan.port), self.driver, tell)

    @property
    def port(self) -> str:
        """The name of its port; that of a virtual one with the path of its link, once it is known."""
        path = self.driver.path if isinstance(self.driver, ProgramListener) else None
        return self.reconnector.port_path if path is None else f"pty:{path}"

    @property
    def programs(self) -> int | None:
        """How many programs use its virtual port; None if it has another one."""
        return self.driver.programs if isinstance(self.driver, ProgramListener) else None

    def means(self, plan: ServerPlan) -> bool:
        """Tell whether it can go on with this plan: whatever units it serves, clients stay connected."""
        return replace(plan, line=replace(plan.line, serves=self.plan.line.serves)) == self.plan

    def adopt(self, plan: ServerPlan) -> None:
        """Go on with this plan, which it `means`."""
        self.plan = plan
        self.driver.adopt(plan.line)
