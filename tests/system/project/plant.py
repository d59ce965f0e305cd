"""Weighs a silo, and keeps a note of it where a PLC reads."""

import asyncio
import sys
from datetime import UTC, datetime

from silo import Silo

from gateway import ConfigError, Gateway, Refused, RequestError, UnitClient, events


async def note(silo: UnitClient, recipe: UnitClient) -> int:
    """Read the weight, and write it down."""
    weight = await silo.read("weight")
    if not isinstance(weight.value, int) or weight.age > 1 or weight.time > datetime.now(UTC):
        raise ValueError(f"what is this: {weight}")
    await recipe.write_holding(3, [weight.value, 1])
    return weight.value


async def writes(gateway: Gateway) -> list[events.WriteAudit]:
    """Wait for two writes."""
    found: list[events.WriteAudit] = []
    async for event in gateway.events():
        if isinstance(event, events.WriteAudit):
            found.append(event)
        if len(found) == 2:
            break
    return found


async def main(config: str) -> None:
    """Tell what comes of it."""
    async with Gateway.from_toml(config, units={60: Silo(950)}) as gateway:
        heard = asyncio.create_task(writes(gateway))
        silo, recipe = gateway.unit("silo"), gateway.unit(200)
        print("weight", await note(silo, recipe))
        await silo.write("zero", 1)
        registers: list[int] = await recipe.read_holding(3, 2)
        bits: list[bool] = []
        try:
            bits = await silo.read_coils(0, 8)
        except Refused as refused:
            print("refused with", refused.code)
        except RequestError as error:
            print("failed with", error.code)
        print(gateway.addresses[0].partition(":")[0], registers, bits, await note(silo, recipe))
        print([event.unit for event in await heard])


if __name__ == "__main__":
    try:
        asyncio.run(main(sys.argv[1]))
    except ConfigError as error:
        sys.exit("\n".join(str(problem) for problem in error.problems))
