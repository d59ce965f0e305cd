"""The page of all values: the latest known one of each point, by device, as selected by the address."""

import asyncio
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, NamedTuple, get_args
from urllib.parse import quote, urlencode
from zlib import crc32

from aiohttp import web

from gateway.clock.slices import in_slices
from gateway.operator.operations.answers.known_values import KnownValue, ValueState
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker
from gateway.operator.values.known_values import Known, devices_with_points, known_points, state_of, told
from gateway.operator.values.values_csv import values_as_csv
from gateway.profiles.point import Point
from gateway.web.api.asking import asker_of
from gateway.web.pages.addresses import path_of
from gateway.web.pages.page import Page, csv_file, route
from gateway.web.pages.sparkline import Sparkline, Sparklines, sparklines

#: So many points are shown at first, of the smallest devices; and of those that the address opens.
FIRST_SHOWN: Final = 200
MOST_SHOWN: Final = 1000
#: No address names more devices: they would not fit into its length.
MOST_OPENED: Final = 100
_STATES: Final[tuple[ValueState, ...]] = get_args(ValueState)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the address asks for: points with all words of `search`, in this `state` if it is not empty.

    `opened` are the devices whose points are shown, by their signs; None if the address leaves that to the page.
    """

    search: str
    state: str
    opened: Collection[str] | None

    @classmethod
    def of(cls, query: Any) -> "Wanted":
        """Read the query of an address; a state that there is not is none."""
        state, signs = query.get("state", ""), query.get("open")
        opened = None if signs is None else frozenset(signs.split(","))
        return cls(query.get("search", "").strip(), state if state in _STATES else "", opened)

    def has(self, device: str, point: Point) -> bool:
        """Return whether the names of a device and a point, and its unit of measure, have each word of the search."""
        if not self.search:
            return True
        text = f"{device} {point.name} {point.unit}".casefold()
        return all(word in text for word in self.search.casefold().split())

    @property
    def query(self) -> str:
        """The search as the query of an address."""
        return urlencode(self._chosen)

    def address(self, opened: Sequence[str]) -> str:
        """Make the address of the page with these devices open; of very many, the last ones."""
        return f"/values?{urlencode([*self._chosen, ('open', ','.join(opened[-MOST_OPENED:]))], safe=',')}"

    @property
    def _chosen(self) -> list[tuple[str, str]]:
        return [(name, text) for name, text in (("search", self.search), ("state", self.state)) if text]


@dataclass(slots=True)
class Found:
    """A device, and what is known of those of its points that were found; `counts` of those that are stale or never.

    Whether a value is invalid is found out where it is shown.
    """

    unit: UnitPicture
    known: list[Known] = field(default_factory=list)
    counts: Counter[ValueState] = field(default_factory=Counter)

    @property
    def sign(self) -> str:
        """What the device is called in an address: short, and the same after a reload."""
        return f"{crc32(self.unit.name.encode()):x}"

    def take(self, known: Known, now: float) -> None:
        """Add a point."""
        self.known.append(known)
        if known.read is None:
            self.counts["never"] += 1
        elif known.is_stale(now):
            self.counts["stale"] += 1


@dataclass(frozen=True, slots=True)
class ShownDevice:
    """A device as the page shows it. `rows` is None while it is folded, and `opened` the address that opens it.

    So many of its points are `left_out`.
    """

    unit: UnitPicture
    sign: str
    count: int
    counts: Sequence[tuple[ValueState, int]]
    rows: Iterator["Row"] | None
    opened: str
    left_out: int


class Row(NamedTuple):
    """A point, and its latest known value as text; without any, `age_ms` is None."""

    point: Point
    text: str
    state: ValueState
    age_ms: float | None
    source: str
    address: str
    trend: Sparkline | None


class ValuesPage(Page):
    """The handlers of `/values` and `/values.csv`."""

    @route("GET", "/values")
    async def show(self, request: web.Request) -> web.Response:
        """Show the values that the address selects, of those that the visitor may read."""
        wanted, now = Wanted.of(request.query), asyncio.get_running_loop().time()
        found = await self._found(wanted, asker_of(request), now)
        return await self._renderer.page(
            "all_values.html",
            request,
            wanted=wanted,
            states=_STATES,
            count=sum(len(each.known) for each in found),
            devices=list(_shown(found, wanted, now, await sparklines(self._operator))),
            has_points=bool(devices_with_points(self._operator)),
        )

    @route("GET", "/values.csv")
    async def download(self, request: web.Request) -> web.Response:
        """Send the values that the address selects as CSV."""
        wanted, now, day = Wanted.of(request.query), asyncio.get_running_loop().time(), time.time()
        found = await self._found(wanted, asker_of(request), now)
        values: list[KnownValue] = await in_slices(
            told(each.unit, known, now, day) for each in found for known in each.known
        )
        return await csv_file("values", lambda: values_as_csv(values))

    async def _found(self, wanted: Wanted, asker: Asker, now: float) -> list[Found]:
        """Find the points, by device, with pauses for the lines."""
        by_unit: dict[int, Found] = {}

        def all_points() -> Iterator[None]:
            for unit in devices_with_points(self._operator):
                for known in known_points(self._operator, unit, asker):
                    yield
                    if not wanted.has(unit.name, known.point):
                        continue
                    if wanted.state and state_of(known, known.reading, now) != wanted.state:
                        continue
                    if unit.key not in by_unit:
                        by_unit[unit.key] = Found(unit)
                    by_unit[unit.key].take(known, now)

        await in_slices(all_points())
        return list(by_unit.values())


def _shown(found: Sequence[Found], wanted: Wanted, now: float, trends: Sparklines) -> Iterator[ShownDevice]:
    """Fold devices for which there is no room; rows are made when they are needed."""
    opened, room = _opened(found, wanted), MOST_SHOWN
    for each in found:
        known = each.known[:room] if each.sign in opened else []
        room -= len(known)
        yield ShownDevice(
            each.unit,
            each.sign,
            len(each.known),
            sorted(each.counts.items()),
            map(partial(_row, each.unit, now, trends), known) if each.sign in opened else None,
            f"{wanted.address([*opened, each.sign])}#device-{each.sign}",
            len(each.known) - len(known) if each.sign in opened else 0,
        )


def _opened(found: Sequence[Found], wanted: Wanted) -> list[str]:
    """List the signs of the devices whose points are shown."""
    if wanted.opened is not None:
        return [each.sign for each in found if each.sign in wanted.opened]
    opened, room = [], FIRST_SHOWN
    for each in sorted(found, key=lambda each: len(each.known)):
        if len(each.known) <= room:
            opened.append(each.sign)
            room -= len(each.known)
    return opened


def _row(unit: UnitPicture, now: float, trends: Sparklines, known: Known) -> Row:
    reading, read, name, age = known.reading, known.read, known.point.name, known.age(now)
    return Row(
        known.point,
        "" if reading is None else reading.text,
        state_of(known, reading, now),
        None if age is None else 1000 * age,
        "" if read is None else read.caller.client,
        f"{path_of('units', unit)}?trend={quote(name)}#trend",
        trends.of(unit, known.point),
    )
