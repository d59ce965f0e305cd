"""Estimates of the clocks of another site's gateways, from their last heartbeats.

A heartbeat has travelled for an unknown time. So the other clock shows at least the time in it plus the time since it
came, less the most that the other clock may be slow. The estimate is never too late: a deadline made from it is early.
"""

import re
from math import inf, isfinite
from typing import Final

#: Seconds between heartbeats, and the silence after which the clock of a site is unknown.
INTERVAL: Final = 1.0
SILENCE: Final = 3.5
#: How much slower the other clock may run, as a share. Quartz clocks differ by less than 0.01 %, but a time service may
#: change the rate of each by up to 8.33 %.
DRIFT: Final = 1 / 6
#: A site has one gateway, or two with one on standby. Beyond this number the one heard longest ago is forgotten.
MOST_GATEWAYS: Final = 4

_INSTANCE = re.compile(r"[0-9a-f]{1,32}")
_LONGEST_BODY: Final = 64
_LONGEST_HEADER: Final = 1024


class Clocks:
    """The clocks of one site's gateways: what each instance has shown, and when."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, float]] = {}

    def hear(self, body: bytes, now: float) -> bool:
        """Take a heartbeat received at `now`. Return False if it is not one."""
        instance, _, told = body[:_LONGEST_BODY].decode("ascii", errors="replace").partition(" ")
        shown = _number(told)
        if _INSTANCE.fullmatch(instance) is None or shown is None:
            return False
        self._heard.pop(instance, None)
        self._heard[instance] = (shown, now)
        if len(self._heard) > MOST_GATEWAYS:
            del self._heard[next(iter(self._heard))]
        return True

    def is_heard(self, now: float) -> bool:
        """Tell whether a heartbeat came within the last SILENCE seconds."""
        return any(now - at < SILENCE for _, at in self._heard.values())

    def silence(self, now: float) -> float:
        """Return the seconds since the last heartbeat; infinite if there was none."""
        return now - max((at for _, at in self._heard.values()), default=-inf)

    def deadline(self) -> float | None:
        """Return the time at which the last heartbeat is SILENCE seconds old; None if there was none."""
        return max((at + SILENCE for _, at in self._heard.values()), default=None)

    def until(self, seconds: float, now: float) -> str:
        """Format the deadline header: the earliest time that each clock may show `seconds` after `now`."""
        shown = {
            each: told + (now - at + seconds) * (1 - DRIFT)
            for each, (told, at) in self._heard.items()
            if now - at < SILENCE
        }
        return " ".join(f"{each}={clock:.6f}" for each, clock in shown.items())


def heartbeat(instance: str, clock: float) -> bytes:
    """Encode a heartbeat with the time of `clock`, in seconds."""
    return f"{instance} {clock:.6f}".encode("ascii")


def deadline_for(instance: str, header: str) -> float | None:
    """Read the deadline of `instance`, by its own clock, from a header; None if there is none."""
    for each in header[:_LONGEST_HEADER].split(" "):
        name, _, text = each.partition("=")
        if name == instance:
            return _number(text)
    return None


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if isfinite(number) else None
