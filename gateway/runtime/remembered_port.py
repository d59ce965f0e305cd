"""The port of a line whose devices can change its rate: the next run finds them there."""

from dataclasses import replace

from gateway.config.plan.settings import LinePlan
from gateway.ports.port import Opener, Port, PortUser, SerialSettings
from gateway.runtime import remembered
from gateway.state.memory import Memory


class RememberedPort:
    """A line's port, opened at the rate that the line has changed to, if any. A device server keeps its rate."""

    def __init__(self, plan: LinePlan, opener: Opener, memory: Memory) -> None:
        self._plan = plan
        self._opener = opener
        self._memory = memory

    @property
    def baud(self) -> int:
        """The present rate."""
        return remembered.rate(self._plan, self._memory)

    def rate_changed(self, baud: int) -> None:
        """Remember that the line has changed its rate."""
        self._memory.remember(remembered.rate_key(self._plan), self._plan.line.timing.baud, baud)

    async def open(self, user: PortUser) -> Port:
        """Open the port. Raises PortError."""
        settings = self._plan.port
        if isinstance(settings, SerialSettings):
            settings = replace(settings, baud=self.baud)
        return await self._opener(settings)(user)
