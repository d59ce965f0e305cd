"""Makes the units that the config names by their classes."""

from functools import partial
from pathlib import Path

from gateway.config.machine.unit_class import find_class, in_time, told
from gateway.config.problem import WrongValue
from gateway.errors import ConfigError
from gateway.images.custom_unit import CustomUnit


def made(python: str, folder: Path) -> CustomUnit:
    """Make a unit of the class `python`, `module:Name`, imported as `find_class` says. Blocks, as `in_time` does.

    Raises:
        ConfigError: there is no such class, it cannot be a unit, or it fails when one is made.
    """
    try:
        return in_time(python, partial(_made, python, folder))
    except WrongValue as wrong:
        raise ConfigError("; ".join(filter(None, (str(wrong), wrong.remedy)))) from None


def _made(python: str, folder: Path) -> CustomUnit:
    unit = find_class(python, folder)
    try:
        return unit()
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever the code of others raises
        raise WrongValue(f"{python} cannot be made: {told(error)}") from None
