"""Names of functions on pages; `functions.json` among the translations has these words."""

from collections.abc import Mapping
from typing import Final

_NAMES: Final[Mapping[int, str]] = {
    1: "read coils",
    2: "read discrete",
    3: "read holding",
    4: "read input",
    5: "write coil",
    6: "write register",
    7: "exception status",
    8: "diagnostics",
    11: "event counter",
    12: "event log",
    15: "write coils",
    16: "write registers",
    17: "server ID",
    20: "read file",
    21: "write file",
    22: "mask write",
    23: "read and write",
    24: "read FIFO",
    43: "identification",
}


def function_name(function: int) -> str:
    """Return the name of a function code, in English."""
    return _NAMES.get(function, "other functions")
