"""What a program gives to a gateway that is a part of it: units made in Python, and perhaps a folder for its state."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from pydantic import ValidationError

from gateway.config.problem import Path, Problem, error
from gateway.config.reading.wording import value_problems
from gateway.config.schema.config import Config
from gateway.config.schema.image import Image

#: What the path of a problem about a unit of the program begins with; its number follows.
_UNITS: Final = "units"
_NO_STATE: Final = "needs a folder, and the gateway was given none"
_GIVE_ONE: Final = 'name one where the gateway is made: state="FOLDER"'


class WithUnits(NamedTuple):
    """A config with the units of the program, and what is wrong with these."""

    config: Config
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True, slots=True)
class Embedding:
    """What a program gives: `units` are the names of the classes of its own units, by number.

    What is to outlive the process needs a state folder.
    """

    units: Mapping[int, str] = field(default_factory=dict)
    has_state: bool = True

    def added_to(self, config: Config) -> WithUnits:
        """Add the units to a config: each takes the place of its `[[image]]` with `python`, or is one more."""
        given = dict(self.units)
        images = [
            image.model_copy(update={"python": given.pop(image.unit)}) if _is_for(image, given) else image
            for image in config.image
        ]
        problems: list[Problem] = []
        for unit, name in given.items():
            path = (_UNITS, unit)
            try:
                own = Image.model_validate({"unit": unit, "name": f"{name.lower()}-{unit}"})
            except ValidationError as wrong:
                problems += value_problems(wrong, Image, path, lambda _: "")
            else:
                own = own.model_copy(update={"python": name})
                images.append(own.placed(path, f"{_UNITS}[{unit}]"))
        return WithUnits(config.model_copy(update={"image": tuple(images)}), tuple(problems))

    def check(self, config: Config) -> Iterator[Problem]:
        """Find what must be kept in a folder, if there is none."""
        if self.has_state:
            return
        for image in config.image:
            if image.persist != "never":
                yield error((*image.path, "persist"), _NO_STATE, _GIVE_ONE)
        if config.mqtt is not None and config.mqtt.keep:
            yield error((*config.mqtt.path, "keep"), _NO_STATE, _GIVE_ONE)


def is_about_units(path: Path) -> bool:
    """Tell whether a problem is about a unit of the program, which stands in no config."""
    return len(path) > 1 and path[0] == _UNITS


def _is_for(image: Image, given: Mapping[int, str]) -> bool:
    return image.unit in given and image.python is not None
