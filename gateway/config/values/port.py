"""The port of a line, and its character format."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address
from gateway.config.values.files import check_path
from gateway.timing.characters import CharacterFormat

#: What is spoken behind a device server, by the scheme of its address. A line's port is one of these, or a path.
DEVICE_SERVER_MODES: Final[Mapping[str, Literal["rtu", "ascii"]]] = {"rtu+tcp": "rtu", "ascii+tcp": "ascii"}


_VIRTUAL: Final = "pty:"
#: A link beside the control socket.
_LINK_NAME: Final = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,64}")
#: The format of a line that has none in the config, by its mode.
DEFAULT_FORMATS: Final[Mapping[Literal["rtu", "ascii"], CharacterFormat]] = {
    "rtu": CharacterFormat(8, "E", 1),
    "ascii": CharacterFormat(7, "E", 1),
}

#: What a pseudo-terminal carries, whatever a program sets.
VIRTUAL_FORMAT: Final = CharacterFormat(8, "N", 1)


@dataclass(frozen=True, slots=True)
class VirtualPort:
    """A virtual port: the `name` of its link beside the control socket, or the absolute path of its link."""

    name: str

    def __str__(self) -> str:
        return f"{_VIRTUAL}{self.name}"


def parse_line_port(value: object) -> str | Address | VirtualPort:
    """Parse a line's port: as `parse_port`, or a virtual one."""
    if not isinstance(value, str) or not value.startswith(_VIRTUAL):
        return parse_port(value)
    name = check_path(value.removeprefix(_VIRTUAL))
    if name.startswith("/") and not name.endswith("/"):
        return VirtualPort(name)
    if not _LINK_NAME.fullmatch(name) or name.endswith(".sock"):
        raise WrongValue(f'"{name}" is neither a name nor an absolute path', 'write a name such as "pty:ttyHMI"')
    return VirtualPort(name)


def parse_port(value: object) -> str | Address:
    """Parse a port that exists: the path of a serial device, or the address of a device server."""
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


def parse_format(value: object) -> CharacterFormat:
    """Parse a character format such as "8E1"."""
    if not isinstance(value, str):
        raise NotText
    try:
        return CharacterFormat.parse(value.upper())
    except ValueError as wrong:
        raise WrongValue(f'"{value}" is not a valid character format', str(wrong)) from wrong


def fits_mode(value: CharacterFormat, mode: Literal["rtu", "ascii"]) -> bool:
    """Tell whether the format can carry this mode: RTU needs 8 data bits (S 2.5.1)."""
    return mode == "ascii" or value.data_bits == 8
