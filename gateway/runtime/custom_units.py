"""Makes the units that the config names by their classes."""

from pathlib import Path

from gateway.config.machine.unit_class import find_class, told
from gateway.config.problem import WrongValue
from gateway.errors import ConfigError
from gateway.images.custom_unit import CustomUnit


def made(python: str, folder: Path) -> CustomUnit:
    """Make a unit of the class `python`, `module:Name`, which is imported as `find_class` says. Its code may block.

    Raises:
        ConfigError: there is no such class, it cannot be a unit, or it fails when one is made.
    """
    try:
        unit = find_class(python, folder)
    except WrongValue as wrong:
        raise ConfigError("; ".join(filter(None, (str(wrong), wrong.remedy)))) from None
    try:
        return unit()
    except Exception as error:
        raise ConfigError(f"{python} cannot be made: {told(error)}") from error
