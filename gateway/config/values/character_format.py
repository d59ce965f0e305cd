"""Character formats of lines: as a user writes them, the usual ones, and which of them RTU can use."""

from collections.abc import Mapping
from typing import Final, Literal

from gateway.config.problem import NotText, WrongValue
from gateway.timing.characters import CharacterFormat

#: The format of a line that has none in the config, by its mode.
DEFAULT_FORMATS: Final[Mapping[Literal["rtu", "ascii"], CharacterFormat]] = {
    "rtu": CharacterFormat(8, "E", 1),
    "ascii": CharacterFormat(7, "E", 1),
}

#: What a pseudo-terminal carries, whatever a program sets.
VIRTUAL_FORMAT: Final = CharacterFormat(8, "N", 1)


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
