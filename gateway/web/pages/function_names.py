"""Names of functions on pages, short enough for tables."""

from collections.abc import Mapping
from typing import Final

from gateway.web.text.words import N_

_NAMES: Final[Mapping[int, str]] = {
    1: N_("read coils"),
    2: N_("read discrete"),
    3: N_("read holding"),
    4: N_("read input"),
    5: N_("write coil"),
    6: N_("write register"),
    7: N_("exception status"),
    8: N_("diagnostics"),
    11: N_("event counter"),
    12: N_("event log"),
    15: N_("write coils"),
    16: N_("write registers"),
    17: N_("server ID"),
    20: N_("read file"),
    21: N_("write file"),
    22: N_("mask write"),
    23: N_("read and write"),
    24: N_("read FIFO"),
    43: N_("identification"),
}


def function_name(function: int) -> str:
    """Return the name of a function code, in English."""
    return _NAMES.get(function, N_("other functions"))
