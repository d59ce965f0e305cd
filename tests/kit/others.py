"""Somebody else's client and its devices on a bus that the gateway only hears."""

import asyncio

from gateway.modbus import rtu
from kit.device import SimulatedDevice, SimulatedLine
from kit.memory import MemoryLine


class Others:
    """A client of `devices` on the bus that `line` hears."""

    def __init__(self, line: MemoryLine, *devices: SimulatedDevice) -> None:
        self._line = line
        self._bus = SimulatedLine("rtu", *devices)

    async def ask(self, unit: int, pdu: str) -> None:
        """Ask a device, and wait for its answer; without one, for half a second."""
        loop = asyncio.get_running_loop()
        request = rtu.encode(unit, bytes.fromhex(pdu))
        self._line.deliver(request)
        answers = self._bus.received(request, loop.time())
        for delay, response in answers:
            loop.call_later(delay, self._line.deliver, response)
        await asyncio.sleep(max((delay for delay, _ in answers), default=0.5) + 0.1)

    async def repeat(self, unit: int, *pdus: str, every: float) -> None:
        """Ask for the same again and again, until cancelled."""
        while True:
            for pdu in pdus:
                await self.ask(unit, pdu)
            await asyncio.sleep(every)
