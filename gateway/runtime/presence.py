"""What this gateway tells other sites about itself."""

import asyncio
from collections.abc import Iterator, Mapping
from socket import gethostname
from typing import Any

from gateway import __version__
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.running import Running


def tell(running: Running) -> Mapping[str, Any]:
    """Tell its host, how long it is up, its lines and its units; see gateway.fleet.presence."""
    gateway = running.gateway
    lines: list[GatewayLine | GatewayServer] = [*gateway.lines, *gateway.servers]
    down = [part.name for part in gateway.parts if not part.reconnector.is_open and not getattr(part, "is_standby", 0)]
    return {
        "host": gethostname(),
        "version": __version__,
        "up_s": round(asyncio.get_running_loop().time() - running.started, 1),
        "lines": sum(part.name not in down for part in lines),
        "lines_down": down,
        "units": len(set(served_units(running))),
    }


def served_units(running: Running) -> Iterator[int]:
    """List the units that other sites reach here now: none of a line on which another gateway may ask."""
    elsewhere = {unit for line in running.gateway.lines if line.is_standby for unit in line.devices}
    return (unit for unit in running.routers.sites.routes if unit not in elsewhere)
