"""The operations `inventory` and `fleet`: what this gateway is and has, and what the other sites report."""

import asyncio
import hashlib
import platform
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Literal

from gateway.clock.threads import ThreadPerCall
from gateway.clock.times import rfc_3339
from gateway.config.plan.settings import LinePlan, MonitorPlan, Plan, ServerPlan
from gateway.config.reading.masking import fingerprint
from gateway.errors import FleetError, WrongQuestion
from gateway.hardware.listing import describe_adapter
from gateway.operator.operations.answers.inventory import (
    AppliedConfig,
    Inventory,
    InventoryAdapter,
    InventoryDevice,
    InventoryLine,
)
from gateway.operator.operations.answers.status import Sites
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operator import Operator
from gateway.operator.units.units import shown_unit
from gateway.ports.port import SerialSettings
from gateway.readconfig.expiry import certificates
from gateway.version import __version__

_Serial = LinePlan | ServerPlan | MonitorPlan


async def tell_inventory(operator: Operator, _asked: Nothing, _asker: Asker) -> Inventory:
    """Describe the gateway. The adapters are looked at in a thread."""
    loop, running, reloader = asyncio.get_running_loop(), operator.running, operator.reloader
    plan, clock = running.gateway.plan, operator.clock()
    begin_of_loop = clock - loop.time()
    sha256, since = hashlib.sha256(reloader.text.encode()).hexdigest(), begin_of_loop + reloader.applied_at
    seen = partial(look_at_machine, plan, reloader.text)
    mark, adapters = await loop.run_in_executor(ThreadPerCall("inventory"), seen)
    applied = AppliedConfig(reloader.place, sha256, mark, rfc_3339(since, "seconds"))
    return Inventory(
        version=__version__,
        host=platform.node(),
        site=plan.site,
        started=rfc_3339(begin_of_loop + running.started, "seconds"),
        config=applied,
        adapters=adapters,
        lines=tuple(_lines(plan)),
        devices=tuple(_devices(plan)),
        certificates=tuple(certificates(running.contexts, clock)),
    )


async def tell_sites(operator: Operator, _asked: Nothing, _asker: Asker) -> Sites:
    """Return what the sites of the fleet report about themselves.

    Raises:
        WrongQuestion: they are not known.
    """
    try:
        return Sites(tuple(await operator.running.add_ons.fleet.sites()))
    except FleetError as error:
        raise WrongQuestion(f"the other sites are not known: {error}") from error


def look_at_machine(plan: Plan, text: str) -> tuple[str, tuple[InventoryAdapter, ...]]:
    """Return the fingerprint of the config with this `text`, and the adapters. Blocks."""
    return fingerprint(text, plan.site), tuple(_adapters(plan))


def _adapters(plan: Plan) -> Iterator[InventoryAdapter]:
    lines: tuple[_Serial, ...] = (*plan.lines, *plan.servers, *plan.monitors)
    for each in lines:
        if isinstance(each.port, SerialSettings):
            found = describe_adapter(each.port.port)
            yield InventoryAdapter(each.line.name, each.port.port, found.device, found.driver, found.ids, found.usb)


def _lines(plan: Plan) -> Iterator[InventoryLine]:
    roles: tuple[tuple[Literal["client", "server", "monitor"], Sequence[_Serial]], ...]
    roles = ("client", plan.lines), ("server", plan.servers), ("monitor", plan.monitors)
    for role, lines in roles:
        for each in lines:
            timing, port = each.line.timing, each.port.port
            yield InventoryLine(each.line.name, role, port, timing.mode, timing.baud, str(timing.format))
    for upstream in plan.upstreams:
        yield InventoryLine(upstream.name, "upstream", upstream.port.port, "tcp", None, None)


def _devices(plan: Plan) -> Iterator[InventoryDevice]:
    passing = {line.name for line in plan.lines if line.passes_through}
    for owner in plan.owners:
        for each in owner.devices if owner.name not in passing else ():
            yield InventoryDevice(each.name, shown_unit(each.known_as), each.unit, owner.name, each.profile.name)
