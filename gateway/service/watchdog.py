"""The watchdog: systemd is notified only while the event loop and every line react in time."""

import asyncio
from typing import Final

from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running
from gateway.runtime.summary import summary
from gateway.service.systemd import Notifier

#: While the loop or a line is late by this many seconds, systemd is not notified.
LATE: Final = 1.0
#: The least number of notifications in each watchdog period.
_SIGNS: Final = 3
#: How often the status text is updated, in seconds.
_STATUS_PERIOD: Final = 1.0


async def watch(running: Running, notifier: Notifier) -> None:
    """Update the status, and notify systemd while nothing is late, until cancelled."""
    loop = asyncio.get_running_loop()
    period = min(notifier.watchdog / _SIGNS or _STATUS_PERIOD, _STATUS_PERIOD)
    while True:
        due = loop.time() + period
        await asyncio.sleep(period)
        now = loop.time()
        if now - due < LATE and not stuck(running.gateway, now):
            notifier.alive()
        notifier.status(summary(running.gateway))


def stuck(gateway: Gateway, now: float) -> list[str]:
    """List the names of the lines and upstreams that are late by LATE seconds or more."""
    return [part.name for part in gateway.parts if part.driver.overdue(now) >= LATE]
