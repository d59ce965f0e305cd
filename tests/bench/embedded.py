"""A program with a gateway and an aiohttp server in one loop: what library.py measures.

    embedded.py CONFIG HTTP_PORT     without a CONFIG (-) there is no gateway, and without a port (0) no server

Unit 60 is a CustomUnit. Its values are those that load.c expects of a device.
"""

import asyncio
import sys
from collections.abc import Sequence
from contextlib import AsyncExitStack

from aiohttp import web

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


async def answer(_: web.Request) -> web.Response:
    """Answer what every program answers quickly."""
    return web.json_response({"weight": 1200, "unit": "kg"})


async def main(config: str, port: int) -> None:
    """Serve until the process is ended."""
    async with AsyncExitStack() as stack:
        if config != "-":
            await stack.enter_async_context(Gateway.from_toml(config, units={UNIT: Device()}))
        if port:
            app = web.Application()
            app.router.add_get("/", answer)
            runner = web.AppRunner(app)
            await runner.setup()
            stack.push_async_callback(runner.cleanup)
            await web.TCPSite(runner, "127.0.0.1", port).start()
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
