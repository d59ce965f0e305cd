"""The watchdog: systemd is notified only while the event loop and every line react in time."""

import asyncio
from typing import Final

from gateway.runtime.build import Gateway, Part
from gateway.runtime.running import Running
from gateway.service.systemd import Notifier

#: While the loop or a line is late by this many seconds, systemd is not notified.
LATE: Final = 1.0
#: The least number of notifications in each watchdog period.
_SIGNS: Final = 3
#: How often the status text is updated, in seconds.
_STATUS_PERIOD: Final = 1.0
#: The approximate limit of a summary, in characters: systemd ignores messages longer than 4096 bytes.
_LONGEST_SUMMARY: Final = 1000


async def watch(running: Running, notifier: Notifier) -> None:
    """Notify systemd until cancelled."""
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
    """The lines and upstreams that are late by LATE seconds or more."""
    return [part.name for part in gateway.parts if part.driver.overdue(now) >= LATE]


def summary(gateway: Gateway) -> str:
    """The state of the gateway in one line: `3 of 4 lines up, 7 clients; hall-a: /dev/ttyUSB0 does not exist`."""
    troubles = [trouble for part in gateway.parts if (trouble := _trouble(part))]
    count = len(gateway.parts)
    clients = sum(listener.clients for listener in gateway.listeners)
    text = f"{count - len(troubles)} of {count} lines up, {clients} clients"
    for told, trouble in enumerate(troubles):
        if len(text) + len(trouble) > _LONGEST_SUMMARY:
            return f"{text}; and {len(troubles) - told} more"
        text += f"; {trouble}"
    return text


def _trouble(part: Part) -> str:
    """Why a part's port is not open; empty if it is."""
    reconnector = part.reconnector
    if not reconnector.tried.is_set():
        return f"{part.name}: not tried yet"
    return "" if reconnector.error is None else f"{part.name}: {reconnector.error}"
