"""The port of a line."""

import re
from collections.abc import Mapping
from typing import Final, Literal

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address
from gateway.config.values.files import check_path

#: What is spoken behind a device server, by the scheme of its address. A line's port is one of these, or a path.
DEVICE_SERVER_MODES: Final[Mapping[str, Literal["rtu", "ascii"]]] = {"rtu+tcp": "rtu", "ascii+tcp": "ascii"}


def parse_port(value: object) -> str | Address:
    """Parse a line's port: the path of a serial device, or the address of a device server.

    Raises:
        WrongValue: it is neither.
    """
    if not isinstance(value, str):
        raise NotText
    if "://" in value:
        return parse_address(value, tuple(DEVICE_SERVER_MODES))
    if not value.startswith("/"):
        raise WrongValue(f'"{value}" is not an absolute path', _meant(value))
    return check_path(value)


def _meant(value: str) -> str:
    """Suggest what may be meant by a port that is no path."""
    if re.fullmatch(r"COM\d+", value, re.IGNORECASE):
        return "modbus-gateway ports lists those of this machine"
    is_address = re.fullmatch(r"[^/]+:\d+", value) is not None
    return f'did you mean "rtu+tcp://{value}"?' if is_address else f'did you mean "/dev/{value}"?'
