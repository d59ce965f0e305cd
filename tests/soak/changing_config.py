"""A config that changes at random, a little each time, with which a gateway is reloaded; and what its units mean."""

import random
from collections.abc import Callable
from typing import Final, NamedTuple

from gateway.timing.characters import CharacterFormat, LineTiming
from soak.faulty_server import TIMEOUT

#: The places where devices are: two ports, a device server, and two Modbus TCP servers.
SERVERS: Final = ("tcp://10.0.0.1:502", "tcp://10.0.0.2:502")
TIMINGS: Final = {
    "/dev/rtu": LineTiming("rtu", 38400, CharacterFormat.parse("8E1")),
    "/dev/ascii": LineTiming("ascii", 38400, CharacterFormat.parse("7E1")),
    "rtu+tcp://10.0.0.9:4001": LineTiming("rtu", 38400, CharacterFormat.parse("8E1")),
}
PLACES: Final = (*TIMINGS, *SERVERS)
#: The line that is always there. It may be the only one, without devices: then it passes all units through.
PASSING: Final = "/dev/rtu"
#: For so long lines await late answers, in seconds.
LATE_WINDOW: Final = 0.5
#: The units of the devices at each place. The config may name one more, which no device has.
UNITS: Final = range(1, 5)
#: What clients know them as.
NUMBERS: Final = range(1, 33)
#: What lines allow their devices, in milliseconds, and how old values of mirrors may be, in seconds.
_LIMITS: Final = (30, 50, 100)
_STALE: Final = (0.5, 1.0, 2.0)
#: Keys of the servers, of which each has one.
_MANNERS: Final = (
    *("", "in_flight = 1", "coalesce = false", "retries = 1", 'gap = "5 ms"', 'idle = "50 ms"', 'rest = "off"'),
    *('transaction_id = "zero"', 'wake = "100 ms"', "in_flight = 2\nqueue = 4"),
)
_FEWEST_UNITS: Final = 2
#: With a point its last reads are kept of each device.
_HEAD: Final = '[profile.generic]\npoints = [{ name = "first", holding = 0 }]\n'
_MIRRORS: Final = ("mirror-a", "mirror-b", "mirror-c", "mirror-d")


class Spot(NamedTuple):
    """Where a device is."""

    place: str
    unit: int


class ChangingConfig:
    """A config. Each unit of a place that is in it, and each mirror, has a number for clients."""

    def __init__(self, dice: random.Random) -> None:
        self._numbers: dict[Spot | str, int] = {}
        #: What is mirrored, and how old the values may be.
        self._mirrors: dict[str, tuple[Spot, float]] = {}
        self._dice = dice
        #: Whether the only line is PASSING, without devices.
        self._passes = False
        self._names = {place: f"hall-{number}" for number, place in enumerate(PLACES)}
        self._limits = dict.fromkeys(PLACES, _LIMITS[0])
        self._manners = dict.fromkeys(SERVERS, _MANNERS[0])
        for place in PLACES:
            self._add(place)

    def change(self) -> None:
        """Change a few things."""
        for _ in range(self._dice.randint(1, 4)):
            self._dice.choice(_CHANGES)(self)
        for name in [name for name, (spot, _) in self._mirrors.items() if spot not in self._numbers]:
            del self._mirrors[name], self._numbers[name]

    @property
    def text(self) -> str:
        """The file."""
        places = [place for place in self._places if not self._passes or place in (PASSING, *SERVERS)]
        mirrors = [name for name, (spot, _) in self._mirrors.items() if self._has(spot)]
        return "".join([_HEAD, *map(self._table, places), *map(self._mirror, mirrors)])

    @property
    def meaning(self) -> dict[int, tuple[Spot, float | None]]:
        """What the numbers mean: where a device is, and of a mirror how old its values may be."""
        means = {unit: (Spot(PASSING, unit), None) for unit in UNITS if self._passes}
        for key, number in self._numbers.items():
            spot, stale = (key, None) if isinstance(key, Spot) else self._mirrors[key]
            if self._has(spot) and (stale or not self._passes or spot.place in SERVERS):
                means[number] = spot, stale
        return means

    # --- changes ---

    def _swap_numbers(self) -> None:
        one, other = self._dice.sample(list(self._numbers), 2)
        self._numbers[one], self._numbers[other] = self._numbers[other], self._numbers[one]

    def _swap_names(self) -> None:
        one, other = self._dice.sample(PLACES, 2)
        self._names[one], self._names[other] = self._names[other], self._names[one]

    def _change_limit(self) -> None:
        self._limits[self._dice.choice(PLACES)] = self._dice.choice(_LIMITS)

    def _change_manners(self) -> None:
        self._manners[self._dice.choice(SERVERS)] = self._dice.choice(_MANNERS)

    def _add_or_remove_place(self) -> None:
        place = self._dice.choice(PLACES)
        if place not in self._places:
            self._add(place)
        elif place != PASSING:
            for unit in self._units(place):
                del self._numbers[Spot(place, unit)]

    def _add_or_remove_unit(self) -> None:
        place = self._dice.choice(self._places)
        spot = Spot(place, self._dice.choice((*UNITS, UNITS.stop)))
        if spot not in self._numbers:
            self._numbers[spot] = self._free()
        elif len(self._units(place)) > _FEWEST_UNITS:
            del self._numbers[spot]

    def _add_mirror(self) -> None:
        name = self._dice.choice(_MIRRORS)
        if name not in self._mirrors:
            self._numbers[name] = self._free()
            self._mirrors[name] = self._anything()

    def _remove_mirror(self) -> None:
        if self._mirrors:
            name = self._dice.choice(list(self._mirrors))
            del self._mirrors[name], self._numbers[name]

    def _change_mirror(self) -> None:
        if self._mirrors:
            name = self._dice.choice(list(self._mirrors))
            spot, stale = self._anything()
            self._mirrors[name] = self._dice.choice(((spot, stale), (self._mirrors[name][0], stale)))

    def _pass_or_not(self) -> None:
        self._passes = not self._passes

    # --- what it says ---

    def _has(self, spot: Spot) -> bool:
        """Whether a unit is in it now: what passes through is not what another server has."""
        behind = {number for server in SERVERS for number in self._units(server).values()}
        passes = spot.place == PASSING and spot.unit not in behind
        return passes or spot.place in SERVERS or not self._passes

    @property
    def _places(self) -> list[str]:
        return [place for place in PLACES if self._units(place)]

    def _units(self, place: str) -> dict[int, int]:
        """The units of a place in the config, and what clients know them as."""
        return {spot.unit: self._numbers[spot] for spot in self._spots() if spot.place == place}

    def _spots(self) -> list[Spot]:
        return [spot for spot in self._numbers if isinstance(spot, Spot)]

    def _free(self) -> int:
        return self._dice.choice([number for number in NUMBERS if number not in self._numbers.values()])

    def _add(self, place: str) -> None:
        for unit in UNITS:
            self._numbers[Spot(place, unit)] = self._free()

    def _anything(self) -> tuple[Spot, float]:
        return self._dice.choice(self._spots()), self._dice.choice(_STALE)

    def _table(self, place: str) -> str:
        rows = ", ".join(f"{{ unit = {unit}, as = {number} }}" for unit, number in self._units(place).items())
        if place in SERVERS:
            return f"""
                [[upstream]]
                name    = "{self._names[place]}"
                to      = "{place}"
                timeout = "{1000 * TIMEOUT:g} ms"
                units   = [{rows}]
                {self._manners[place]}
                """
        timing = TIMINGS[place]
        devices = "" if self._passes else f"devices = [{rows}]"
        idle = 'idle = "20 ms"' if "tcp" in place else ""
        return f"""
            [[line]]
            name    = "{self._names[place]}"
            port    = "{place}"
            mode    = "{timing.mode}"
            baud    = {timing.baud}
            format  = "{timing.format}"
            latency = "5 ms"
            timeout = "{self._limits[place]} ms"
            late_window = "{1000 * LATE_WINDOW:g} ms"
            wake    = "300 ms"
            {idle}
            {devices}
            """

    def _mirror(self, name: str) -> str:
        spot, stale = self._mirrors[name]
        known_as = spot.unit if self._passes and spot.place == PASSING else self._numbers[spot]
        return f"""
            [[image]]
            unit  = {self._numbers[name]}
            name  = "{name}"
            of    = "{self._names[spot.place]}/{known_as}"
            stale = "{1000 * stale:g} ms"
            read  = [{{ holding = "0-7", every = "200 ms" }}, {{ input = "0-7", every = "200 ms" }}]
            """


_CHANGES: Final[tuple[Callable[[ChangingConfig], None], ...]] = (
    ChangingConfig._swap_numbers,
    ChangingConfig._swap_numbers,
    ChangingConfig._swap_names,
    ChangingConfig._change_limit,
    ChangingConfig._change_manners,
    ChangingConfig._add_or_remove_place,
    ChangingConfig._add_or_remove_unit,
    ChangingConfig._add_mirror,
    ChangingConfig._add_mirror,
    ChangingConfig._remove_mirror,
    ChangingConfig._change_mirror,
    ChangingConfig._pass_or_not,
)
