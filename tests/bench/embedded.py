"""A program with a gateway, in the event loop that asyncio.run makes: what library.py measures.

    embedded.py CONFIG

Unit 60 is a CustomUnit. Its values are those that load.c expects of a device.
"""

import asyncio
import sys
from collections.abc import Sequence

from gateway import Area, CustomUnit, Gateway

UNIT = 60


def register(unit: int, address: int) -> int:
    """What a device has in a register: `wire_reg` of wire.h."""
    return (unit * 2654435761 + address * 40503 + 0x1234) & 0xFFFF


class Device(CustomUnit):
    """As the simulated devices."""

    async def read(self, area: Area, address: int, count: int) -> Sequence[int]:
        """Return the values of these registers."""
        return [register(UNIT, at) for at in range(address, address + count)]


async def main(config: str) -> None:
    """Serve until the process is ended."""
    async with Gateway.from_toml(config, units={UNIT: Device()}):
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
