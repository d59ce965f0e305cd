"""What other sites are told of this gateway beside its state, found out every minute. Nothing is sent for it."""

import asyncio
import time
from collections.abc import Sequence
from itertools import chain
from typing import Final

from gateway.clock.threads import in_thread
from gateway.diagnosis.finding import Finding
from gateway.fleet.inventory import OwnInventory, SiteAdapter, SiteCertificate, SiteFinding
from gateway.readconfig.expiry import certificates
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running

#: Seconds between looks for a new config, and between examinations.
STEP: Final = 5.0
KEPT: Final = 60.0


async def keep_telling(running: Running, reloader: Reloader) -> None:
    """Keep the inventory of this site up to date while it is connected to a fleet, until cancelled."""
    loop, seen, due = asyncio.get_running_loop(), "", 0.0
    while True:
        fleet = running.add_ons.fleet
        if fleet.is_connected and (reloader.text is not seen or loop.time() >= due):
            seen = reloader.text
            fleet.inventory = await own_inventory(running, reloader)
            due = loop.time() + KEPT
        await asyncio.sleep(STEP)


async def own_inventory(running: Running, reloader: Reloader) -> OwnInventory:
    """Look at this gateway. The adapters are looked at in a thread."""
    from gateway.operator.fleet.inventory import look_at_machine  # noqa: PLC0415 - most gateways are in no fleet

    plan, applied_at = running.gateway.plan, reloader.applied_at
    mark, adapters = await in_thread("site inventory", look_at_machine, plan, reloader.text)
    expiring = sorted(certificates(running.contexts, time.time()), key=lambda each: each.days_left)
    found = await _examined(running)
    to_fix = [each for each in found if each.level == "fix"]
    return OwnInventory(
        config=mark,
        applied_at=applied_at,
        adapters=tuple(SiteAdapter(each.line, each.port, each.driver, each.ids) for each in adapters),
        certificates=tuple(SiteCertificate(each.used_by, each.key, each.until) for each in expiring),
        to_fix=len(to_fix),
        notes=sum(each.level == "note" for each in found),
        worst=tuple(SiteFinding(each.about, each.what) for each in to_fix),
        examined_at=asyncio.get_running_loop().time(),
    )


async def _examined(running: Running) -> Sequence[Finding]:
    """Find what `doctor` would, from what was measured; nothing about clients, whose addresses are in its words."""
    from gateway.tools.doctor import examined  # noqa: PLC0415 - most gateways are in no fleet

    groups, _ = await examined(running, None, lambda: True, asks=False)
    return [*chain.from_iterable(found for _, found in groups[:-1])]
