"""The clocks of the gateways of another site, as far as their last heartbeats tell.

A heartbeat has been under way for an unknown time, so the other clock shows at least what it says, plus the time since
it came, less what the other clock may be slower. What is estimated so is never late: a deadline by it comes early.
"""

import re
from math import inf, isfinite
from typing import Final

#: How often a site says what its clock shows, in seconds, and after what silence nothing is known of it any more.
INTERVAL: Final = 1.0
SILENCE: Final = 3.5
#: How much slower than ours the other clock may run, as a share. Quartz clocks differ by less than 0.01 %, but a time
#: service that corrects them changes the rate of each by up to 8.33 %.
DRIFT: Final = 1 / 6
#: A site has one gateway, or two of which one stands by. Beyond this number the oldest is forgotten.
MOST_GATEWAYS: Final = 4

_INSTANCE = re.compile(r"[0-9a-f]{1,32}")
_LONGEST_BODY: Final = 64
_LONGEST_HEADER: Final = 1024


class Clocks:
    """The clocks of the gateways of one site: the clock of each instance, and when it was heard."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, float]] = {}

    def hear(self, body: bytes, now: float) -> bool:
        """Take a heartbeat; False if it is none."""
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
        """Whether at least one of them was heard lately."""
        return any(now - at < SILENCE for _, at in self._heard.values())

    def silence(self, now: float) -> float:
        """How long none of them has been heard, in seconds; infinite if none ever was."""
        return now - max((at for _, at in self._heard.values()), default=-inf)

    def deadline(self) -> float | None:
        """When the last of them has been silent for too long; None if none was ever heard."""
        return max((at + SILENCE for _, at in self._heard.values()), default=None)

    def until(self, seconds: float, now: float) -> str:
        """The end of this many of our seconds by each of these clocks, or earlier: for the header of a request."""
        shown = {
            each: told + (now - at + seconds) * (1 - DRIFT)
            for each, (told, at) in self._heard.items()
            if now - at < SILENCE
        }
        return " ".join(f"{each}={clock:.6f}" for each, clock in shown.items())


def heartbeat(instance: str, clock: float) -> bytes:
    """What a gateway says of its clock."""
    return f"{instance} {clock:.6f}".encode("ascii")


def deadline_for(instance: str, header: str) -> float | None:
    """The deadline in a header by the clock of this instance; None if there is none."""
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
