"""Reads how the wall clock is set."""

import time
from functools import cache
from pathlib import Path
from typing import Final
from uuid import uuid4

from gateway.timing.clock_setting import ClockSetting

#: systemd-timesyncd has this folder, and this file in it as soon as it has set the clock. adjtimex(2) would tell more,
#: and is denied to the service (ProtectClock=).
_TIMESYNC: Final = Path("/run/systemd/timesync")
_SYNCHRONISED: Final = _TIMESYNC / "synchronized"


def clock_setting() -> ClockSetting:
    """Read how the clock is set now."""
    since_boot = time.clock_gettime(time.CLOCK_BOOTTIME)
    return ClockSetting(_boot(), time.time() - since_boot, _SYNCHRONISED.exists() or not _TIMESYNC.exists())


@cache
def _boot() -> str:
    """Read what names this boot; the service cannot (ProcSubset=pid), so there it is the process that has a name."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return str(uuid4())
