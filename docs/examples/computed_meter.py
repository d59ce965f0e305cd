"""A meter that is computed from two others: a house uses what the grid delivers and what its roof makes.

python docs/examples/computed_meter.py docs/examples/plant.toml
modbus-gateway read 60 input 0 float32 --tcp 127.0.0.1:5020

Without meters at hand: plant.toml says how they are simulated.
"""

import asyncio
import sys
from collections.abc import Sequence
from struct import pack, unpack

from gateway import Area, CustomUnit, DeviceFailure, Gateway, IllegalAddress


class House(CustomUnit):
    """Its power in W, as a float in input registers 0 and 1."""

    async def read(self, area: Area, address: int, count: int) -> Sequence[int]:
        """Compute it, whenever it is asked for."""
        if (area, address, count) != (Area.INPUT, 0, 2):
            raise IllegalAddress("the power is in input registers 0 and 1, which are read together")
        grid, roof = await asyncio.gather(self.power("grid"), self.power("roof"))
        return unpack(">2H", pack(">f", grid + roof))

    async def power(self, meter: str) -> float:
        """Ask a meter. If it does not answer, who asks for the sum gets the same exception."""
        value = (await self.unit(meter).read("active-power")).value
        if not isinstance(value, int | float):
            raise DeviceFailure(f"{meter} has no value at the moment")
        return value


async def main(config: str) -> None:
    """Run until Ctrl-C, and tell what happens."""
    async with Gateway.from_toml(config, units={60: House()}) as gateway:
        print("The house is unit 60 at", *gateway.addresses, flush=True)
        async for event in gateway.events():
            print(event.in_words(), flush=True)


if __name__ == "__main__":
    try:
        asyncio.run(main(sys.argv[1]))
    except KeyboardInterrupt:
        print("stopped")
