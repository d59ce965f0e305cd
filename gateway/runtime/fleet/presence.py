"""What this gateway reports to other sites about itself."""

from collections.abc import Iterator, Mapping
from socket import gethostname
from typing import Any

from gateway.fleet.inventory import MOST_NAMES, OwnInventory
from gateway.modbus.codes import HIGHEST_UNIT
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.version import __version__


def tell(gateway: Gateway, router: Router, up: float, inventory: OwnInventory | None, now: float) -> Mapping[str, Any]:
    """Describe its host, its uptime `up` in seconds, its lines and its units; see gateway.fleet.presence."""
    lines = [part for part in gateway.parts if not isinstance(part, GatewayUpstream)]
    down = [part.name for part in gateway.parts if not part.reconnector.is_open and not getattr(part, "is_standby", 0)]
    return {
        "host": gethostname(),
        "version": __version__,
        "up_s": round(up, 1),
        "lines": sum(part.name not in down for part in lines),
        "lines_down": down[:MOST_NAMES],
        "units": len(set(served_units(gateway, router))),
        **({} if inventory is None else {"inventory": inventory.told(now)}),
    }


def served_units(gateway: Gateway, router: Router) -> Iterator[int]:
    """List the units that other sites reach here now: none of a line on which others ask.

    They ask by numbers only, so not for a device without one.
    """
    elsewhere = {unit for line in gateway.lines if line.is_standby for unit in line.devices}
    elsewhere |= {unit for monitor in gateway.monitors for unit in monitor.devices}
    return (unit for unit in router.routes if unit <= HIGHEST_UNIT and unit not in elsewhere)
