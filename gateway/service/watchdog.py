"""Signs of life for systemd: only while the event loop is quick and every line does what is due."""

import asyncio
from typing import Final

from gateway.service.build import Gateway, Part
from gateway.service.running import Running
from gateway.service.systemd import Notifier

#: A loop, or a line, that is late by so many seconds gives no sign of life.
LATE: Final = 1.0
#: Signs of life in each period that systemd allows, at least.
_SIGNS: Final = 3
#: How soon the status text follows what has happened, in seconds.
_STATUS_PERIOD: Final = 1.0
#: So many characters a summary has at most, roughly: systemd ignores what is longer than 4096 bytes as a whole.
_LONGEST_SUMMARY: Final = 1000


async def watch(running: Running, notifier: Notifier) -> None:
    """Tell systemd how the gateway is doing, until cancelled."""
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
    """The lines and upstreams that should have done something for LATE seconds and more."""
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
    """Why a part has no port; nothing if it has one."""
    reconnector = part.reconnector
    if not reconnector.tried.is_set():
        return f"{part.name}: not tried yet"
    return "" if reconnector.error is None else f"{part.name}: {reconnector.error}"
