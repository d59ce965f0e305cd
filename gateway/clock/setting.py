"""Reads how the wall clock is set."""

import ctypes
import time
from functools import cache
from pathlib import Path
from typing import Final

from gateway.timing.clock_setting import ClockSetting

#: What adjtimex(2) returns while nothing synchronises the clock.
_NOT_SYNCHRONISED: Final = 5
#: More than `struct timex` has on any system; zeros ask for nothing to be changed.
_TIMEX_BYTES: Final = 1024


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
