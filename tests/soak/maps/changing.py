"""A config whose maps, rows, devices and lines change at random, with which a gateway is reloaded."""

import random
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gateway.modbus.codes import Area
from gateway.timing.characters import CharacterFormat, LineTiming
from soak.faulty_server import TIMEOUT
from soak.maps.devices import PROFILE
from soak.maps.random_rows import MapMaker, RandomMap
from soak.maps.rows import BITS, Row, every_point

TIMINGS: Final = {
    "/dev/rtu": LineTiming("rtu", 115200, CharacterFormat.parse("8E1")),
    "/dev/ascii": LineTiming("ascii", 115200, CharacterFormat.parse("7E1")),
}
SERVER: Final = "tcp://10.0.0.1:502"
PLACES: Final = (*TIMINGS, SERVER)
#: The units of the devices at each place, and what clients know them as from here on.
UNITS: Final = (1, 2, 3)
_FIRST: Final = {"/dev/rtu": 0, "/dev/ascii": 10, SERVER: 20}
#: The units of maps, of the mirror, and of the local image, and the name of that.
MAPS: Final = (240, 241, 242)
MIRROR, IMAGE, NOTES = 231, 200, "notes"
#: How often each area is read, in milliseconds, and how often lines and servers repeat a request.
_EVERY: Final = (200, 300, 400)
_RETRIES: Final = (0, 1)
#: What lines allow their devices, in seconds.
_LIMIT: Final = 0.05
_STALE_OF_MIRROR: Final = 1.5


class Spot(NamedTuple):
    """Where a device is."""

    place: str
    unit: int

    @property
    def known_as(self) -> int:
        """The unit for clients."""
        return _FIRST[self.place] + self.unit


SPOTS: Final = tuple(Spot(place, unit) for place in PLACES for unit in UNITS)


class ChangingMaps:
    """A config. `names` are the devices by their names, `maps` the maps by their units."""

    def __init__(self, dice: random.Random) -> None:
        self._dice = dice
        self.names = {f"meter-{number}": spot for number, spot in enumerate(SPOTS)}
        self._retries = dict.fromkeys(PLACES, _RETRIES[0])
        self._every = dict.fromkeys(Area, f"{_EVERY[0]} ms")
        self.mirrored = "meter-0"
        self.maps = {unit: self._maker.make() for unit in MAPS}

    @property
    def _maker(self) -> MapMaker:
        return MapMaker(self._dice, tuple(self.names), (NOTES,))

    def change(self) -> None:
        """Change a thing or two."""
        for _ in range(self._dice.randint(1, 2)):
            self._dice.choice(_CHANGES)(self)

    @property
    def text(self) -> str:
        """The file."""
        lines = map(self._line, PLACES)
        image = f'[[image]]\nunit = {IMAGE}\nname = "{NOTES}"\nholding = 16\n'
        return "".join((PROFILE, *lines, image, self._mirror(), *map(self._map, self.maps, self.maps.values())))

    # --- changes ---

    def _swap_names(self) -> None:
        one, other = self._dice.sample(list(self.names), 2)
        self.names[one], self.names[other] = self.names[other], self.names[one]

    def _change_retries(self) -> None:
        self._retries[self._dice.choice(PLACES)] = self._dice.choice(_RETRIES)

    def _change_pace(self) -> None:
        # One pace for each area, so that any poll over the items of a row reads the row.
        areas = BITS if self._dice.random() < 0.5 else (Area.HOLDING, Area.INPUT)
        self._every |= dict.fromkeys(areas, f"{self._dice.choice(_EVERY)} ms")

    def _change_map(self) -> None:
        unit = self._dice.choice(MAPS)
        self.maps[unit] = self._maker.change(self.maps[unit])

    def _swap_maps(self) -> None:
        one, other = self._dice.sample(MAPS, 2)
        self.maps[one], self.maps[other] = self.maps[other], self.maps[one]

    def _change_mirror(self) -> None:
        self.mirrored = self._dice.choice(list(self.names))

    # --- what it says ---

    def _line(self, place: str) -> str:
        named = {spot.unit: name for name, spot in self.names.items() if spot.place == place}
        timeout = f'profile = "meter", timeout = "{1000 * (TIMEOUT if place == SERVER else _LIMIT):g} ms"'
        rows = ", ".join(
            f'{{ unit = {unit}, as = {Spot(place, unit).known_as}, name = "{named[unit]}", {timeout} }}'
            for unit in UNITS
        )
        if place == SERVER:
            retries = self._retries[place]
            return f'[[upstream]]\nname = "server"\nto = "{place}"\nunits = [{rows}]\nretries = {retries}\n'
        timing = TIMINGS[place]
        return f"""
            [[line]]
            name    = "{place.removeprefix("/dev/")}"
            port    = "{place}"
            mode    = "{timing.mode}"
            baud    = {timing.baud}
            format  = "{timing.format}"
            latency = "5 ms"
            retries = {self._retries[place]}
            devices = [{rows}]
            """

    def _mirror(self) -> str:
        rows = ", ".join(f'{{ {area} = "0-7", every = "{self._every[area]}" }}' for area in (Area.HOLDING, Area.INPUT))
        return f"""
            [[image]]
            unit  = {MIRROR}
            name  = "mirror"
            of    = "{self.mirrored}"
            stale = "{1000 * _STALE_OF_MIRROR:g} ms"
            read  = [{rows}]
            """

    def _map(self, unit: int, it: RandomMap) -> str:
        rows = [_table(group, self._every) for group in it.groups]
        names = ", ".join(f'"{name}"' for name in it.devices)
        rows.append(f'{{ at = {it.bits_at}, area = "{it.bits_area}", fresh = [{names}] }}')
        rows += [f'{{ at = {at}, age = "{name}" }}' for at, name in it.ages.items()]
        own = f'holding = "{it.own.start}-{it.own.stop - 1}"\n' if it.own else ""
        tables = ",\n    ".join(rows)
        head = f'[[image]]\nunit = {unit}\nname = "hall-{unit}"\nstale = "{1000 * it.stale:g} ms"\n{own}'
        return f"{head}map = [\n    {tables},\n]\n"

    @property
    def stale_of_mirror(self) -> float:
        """How old values of the mirror may be."""
        return _STALE_OF_MIRROR


def _table(group: tuple[Row, ...], every: Mapping[Area, str]) -> str:
    return group[0].config(every) if len(group) == 1 else every_point(group, every[group[0].source.area])


_CHANGES: Final[tuple[Callable[[ChangingMaps], None], ...]] = (
    ChangingMaps._swap_names,
    ChangingMaps._change_retries,
    ChangingMaps._change_pace,
    ChangingMaps._change_map,
    ChangingMaps._change_map,
    ChangingMaps._swap_maps,
    ChangingMaps._change_mirror,
)
