"""The port of a line."""

import re
from collections.abc import Mapping
from typing import Final, Literal

from gateway.config.address import Address, parse_address
from gateway.config.files import check_path
from gateway.config.problem import NotText, WrongValue

#: What is spoken behind a device server, by the scheme of its address. A line's port is one of these, or a path.
DEVICE_SERVER_MODES: Final[Mapping[str, Literal["rtu", "ascii"]]] = {"rtu+tcp": "rtu", "ascii+tcp": "ascii"}


def parse_port(value: object) -> str | Address:
    """A line's port: the path of a serial device, or the address of a device server.

    Raises:
        WrongValue: it is neither.
    """
    if not isinstance(value, str):
        raise NotText
    if "://" in value:
        return parse_address(value, tuple(DEVICE_SERVER_MODES))
    if not value.startswith("/"):
        is_of_windows = re.fullmatch(r"COM\d+", value, re.IGNORECASE) is not None
        remedy = (
            "modbus-gateway ports lists those of this machine" if is_of_windows else f'did you mean "/dev/{value}"?'
        )
        raise WrongValue(f'"{value}" is not an absolute path', remedy)
    return check_path(value)
