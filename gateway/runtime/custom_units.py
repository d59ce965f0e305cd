"""Makes the units that the config names by their classes."""

import sys
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Final

from gateway.config.machine.unit_class import find_class, in_time, told
from gateway.config.problem import WrongValue
from gateway.errors import ConfigError
from gateway.images.custom_unit import CustomUnit
from gateway.images.image import ImageSettings

#: When the file of each module was last changed, by its path, when this process imported it.
_changed_at: Final[dict[str, int]] = {}


def made(image: ImageSettings, folder: Path) -> CustomUnit:
    """Make the unit of an image, of the class that it names, imported as `find_class` says. Blocks, as `in_time` does.

    Raises:
        ConfigError: there is no such class, it cannot be a unit, or it fails when one is made.
    """
    try:
        return in_time(image.python, partial(_made, image.python, folder))
    except WrongValue as wrong:
        place = f"{image.source}: image {image.name}" if image.source else f"image {image.name}"
        raise ConfigError("; ".join(filter(None, (f"{place}: {wrong}", wrong.remedy)))) from None


def outdated(images: Iterable[ImageSettings]) -> Iterator[str]:
    """Find the units whose module was changed since it was imported, which Python does once: `image clock`. Blocks."""
    for image in images:
        file = _file_of(image.python)
        if file in _changed_at and _changed_at[file] != _time_of(file):
            yield f"image {image.name}"


def _made(python: str, folder: Path) -> CustomUnit:
    unit = find_class(python, folder)
    file = _file_of(python)
    _changed_at.setdefault(file, _time_of(file))
    try:
        return unit()
    except BaseException as error:  # noqa: BLE001 - whatever the code of others raises
        raise WrongValue(f"{python} cannot be made: {told(error)}") from None


def _file_of(python: str) -> str:
    return getattr(sys.modules.get(python.partition(":")[0]), "__file__", None) or ""


def _time_of(file: str) -> int:
    """Return when a file was changed, in nanoseconds; 0 if it is not there."""
    try:
        return Path(file).stat().st_mtime_ns if file else 0
    except OSError:
        return 0
