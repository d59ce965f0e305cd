"""The kinds of entities that a connection of Home Assistant has."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from gateway.config.importing.from_home_assistant.climate import climate
from gateway.config.importing.from_home_assistant.entities import Found, binary_sensor, cover, sensor, switch
from gateway.config.importing.from_home_assistant.fields import Fields

#: The entities of each key of a connection, and how one of them becomes points.
KINDS: Final[Mapping[str, tuple[str, Callable[[Fields], Iterator[Found]]]]] = {
    "sensors": ("sensor", sensor),
    "binary_sensors": ("binary sensor", binary_sensor),
    "switches": ("switch", switch),
    "lights": ("light", switch),
    "fans": ("fan", switch),
    "covers": ("cover", cover),
    "climates": ("climate", climate),
}
