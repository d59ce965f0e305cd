"""Tells how the wall clock is set: whether anything has set it, and how far it is ahead of the time since boot."""

import ctypes
import time
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

#: What adjtimex(2) returns while nothing synchronises the clock.
_NOT_SYNCHRONISED: Final = 5
#: More than `struct timex` has on any system; zeros ask for nothing to be changed.
_TIMEX_BYTES: Final = 1024
#: A clock was set if it has moved by more than this many seconds; corrections of a clock that runs are smaller.
_STEP: Final = 1.0


class ClockSetting(NamedTuple):
    """How the clock is set: in which `boot`, how many seconds `ahead` of the time since then, and `is_set` by whom.

    `is_set` is False while the kernel says that nothing has synchronised it.
    """

    boot: str
    ahead: float
    is_set: bool

    def has_stepped(self, since: "ClockSetting") -> bool:
        """Tell whether the clock was set since then, in the same boot."""
        return self.boot == since.boot and abs(self.ahead - since.ahead) > _STEP

    def differs(self, since: "ClockSetting") -> bool:
        """Tell whether times of then may be wrong by this clock: it was set since then."""
        return (self.is_set and not since.is_set) or self.has_stepped(since)


def clock_setting() -> ClockSetting:
    """Read how the clock is set now."""
    since_boot = time.clock_gettime(time.CLOCK_BOOTTIME)
    return ClockSetting(_boot(), time.time() - since_boot, _is_synchronised())


@cache
def _boot() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def _is_synchronised() -> bool:
    return _adjtimex(bytes(_TIMEX_BYTES)) != _NOT_SYNCHRONISED


def _adjtimex(timex: bytes) -> int:
    try:
        return int(ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(timex, _TIMEX_BYTES)))
    except (AttributeError, OSError):  # no such call in this C library
        return 0
