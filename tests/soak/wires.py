"""Lines of a dated world: what passes on them meets faults, and their adapters are pulled now and then."""

import asyncio
import random
from collections import deque
from typing import Final

from kit.faulty import Fault, FaultyLine
from kit.memory import MemoryLine
from soak.dated_world import DatedWorld

#: What happens to whole answers; damage is the matter of `worlds.lines`. Behind a device server there are no copies:
#: they could fall into anything.
SERVER_FAULTS: Final = {Fault.LATE: 3.0, Fault.LATE_EXCEPTION: 1.0, Fault.EXCEPTION: 1.0, Fault.SILENT: 1.0}
FAULTS: Final = SERVER_FAULTS | dict.fromkeys((Fault.DUPLICATE, Fault.STALE, Fault.FOREIGN_UNIT, Fault.WRONG_SIZE), 1.0)
#: So much that has passed is told when something is wrong.
_TOLD: Final = 24


class Wire:
    """A line in memory and the devices on it."""

    def __init__(self, world: DatedWorld, name: str, line: MemoryLine, faulty: FaultyLine) -> None:
        self.line = line
        self.faulty = faulty
        self._world = world
        self._name = name
        #: How often it was pulled: what was under way from before that is lost.
        self._pulls = 0
        self._passed: deque[str] = deque(maxlen=_TOLD)
        world.passed |= dict.fromkeys((device.number for device in faulty.devices), self._passed)
        line.on_write = self._written

    def _written(self, data: bytes) -> None:
        self.line.written.clear()
        self._world.tally.transactions += 1
        answers = self.faulty.received(data, self._world.loop.time())
        self._world.tally.injected[self.faulty.last.fault.value] += 1
        self._note(">>", data, self.faulty.last.fault)
        for delay, answer in answers:
            self._world.loop.call_later(delay, self._deliver, answer, self._connection)

    @property
    def _connection(self) -> tuple[int, int]:
        """Which connection it is; a serial port that is opened again is the same one."""
        return self._pulls, self.line.openings if self.line.has_arrived else 0

    def _deliver(self, data: bytes, connection: tuple[int, int]) -> None:
        if connection == self._connection:
            data = self.faulty.chance.spoil(data)
            self._note("<<", data)
            self.line.deliver(data)

    def _note(self, way: str, data: bytes, fault: str = "") -> None:
        shown = repr(data) if self.faulty.timing.mode == "ascii" else data.hex(" ").upper()
        self._passed.append(f"{self._world.loop.time():.6f} {self._name} {way} {shown} {fault}")

    async def keep_pulling(self) -> None:
        """Pull its adapter now and then, and plug it in again."""
        dice = random.Random(self._world.dice.random())
        while not self._world.is_over:
            await asyncio.sleep(dice.uniform(2.0, 15.0))
            self._pulls += 1
            self.line.pull()
            await asyncio.sleep(dice.uniform(0.001, 2.0))
            self.line.plug()
