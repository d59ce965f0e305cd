"""The page of an image, mirror or virtual unit: its values, their ages and sources, and their last writers."""

import asyncio
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final
from urllib.parse import urlencode

from aiohttp import web

from gateway.clock.slices import in_slices
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.images.grid import COLUMNS, MOST, grid_of
from gateway.operator.images.kept import ImageWindow, window
from gateway.operator.images.map_lines import MapLine, map_lines
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.status.status import part_of_unit
from gateway.operator.units.reached import image_of, readable_for
from gateway.operator.units.units import points_within, units_of
from gateway.operator.values.unit_values import values_at
from gateway.profiles.point import NO_VALUE, Point
from gateway.profiles.profile import Range
from gateway.registers.datatypes import DATA_TYPES, SWAPS
from gateway.registers.items import has_bits
from gateway.web.access.guard import VISITOR
from gateway.web.api.asking import asker_of, unit_in
from gateway.web.front.problems import ProblemError
from gateway.web.pages.addresses import path_of, see_other
from gateway.web.pages.fields import whole
from gateway.web.pages.page import Page, route
from gateway.web.pages.points import points_shown

_FIRST_SHOWN: Final = (Area.HOLDING, Area.INPUT, Area.COILS, Area.DISCRETE)
#: This many writes are listed.
_MOST_WRITES: Final = 20


class ImagePage(Page):
    """The handler of `/images/NAME`. NAME is a name or a number."""

    @route("GET", "/images/{unit}")
    async def show(self, request: web.Request) -> web.Response:
        """Show some addresses of one area. The address names `area`, `from`, `type` and `swap`.

        Raises:
            ProblemError: there is no such area or address.
            WrongQuestion: there is no such unit, or the type or swap does not fit.
        """
        unit, asker = unit_in(request, self._operator), asker_of(request)
        whole_image = self._window(unit, Span(Area.HOLDING, 0, 0))
        if whole_image is None:
            return see_other(path_of("units", unit))
        asked = _asked(request.query, whole_image.areas)
        area, ranges = asked["area"], whole_image.areas.get(asked["area"], ())
        start = asked["from"]
        readable, there = readable_for(self._operator, unit, asker), Span(area, start, MOST)
        parts = readable.parts(there)
        shown = self._window(unit, there, parts) if parts else None
        grid = grid_of(shown, area, asked["type"], asked["swap"]) if shown is not None else None
        size, is_panel = 1 if grid is None else grid.size, "kiosk" in request.query
        points = points_within(self._operator, unit, there)
        mapped = [each for each in await self._mapped(unit, points, there) if readable.has(each.point.read_span)]
        return await self._renderer.page(
            "image.html",
            request,
            unit=unit,
            status=await part_of_unit(self._operator.gateway, unit.unit, unit.name),
            image=whole_image,
            window=shown,
            grid=grid,
            last=min(start + MOST - 1, 65535),
            writes=shown.writes[:_MOST_WRITES] if shown is not None else (),
            ranges=ranges,
            before=_address(asked, _before(ranges, start), is_panel=is_panel),
            after=_address(asked, _after(ranges, start, size), is_panel=is_panel),
            columns=COLUMNS,
            mapped=mapped,
            with_page=frozenset(each.name for each in units_of(self._operator)),
            names_at=_Names(points).at,
            asked=asked,
            areas=[each for each in _FIRST_SHOWN if whole_image.areas.get(each)],
            types=tuple(DATA_TYPES),
            swaps=tuple(SWAPS),
            **self._points(unit, request),
        )

    async def _mapped(self, unit: UnitPicture, points: Sequence[Point], span: Span) -> Sequence[MapLine]:
        """List the values of a virtual unit at some addresses, with pauses for the lines; nothing of any other unit."""
        virtual = image_of(self._operator.gateway, unit.key)
        if not isinstance(virtual, VirtualUnit):
            return ()
        return await in_slices(map_lines(virtual, points, span, asyncio.get_running_loop().time()))

    def _points(self, unit: UnitPicture, request: web.Request) -> dict[str, Any]:
        """Collect what the template shows of points; those of a virtual unit are among its mapped values."""
        if unit.kind == "virtual":
            return {"no_value": NO_VALUE, **self._rights.of(unit, request[VISITOR]).as_content()}
        return points_shown(self._operator, self._rights, unit, request)

    def _window(self, unit: UnitPicture, span: Span, parts: Sequence[Span] = ()) -> ImageWindow | None:
        return window(self._operator.gateway, unit.key, span, parts, asyncio.get_running_loop().time())


class _Names:
    """The names of points of an area at each of their addresses, with their bits: `alarm .3`."""

    def __init__(self, points: Iterable[Point]) -> None:
        self._names: dict[int, list[str]] = {}
        for point in points:
            for address in range(point.address, point.address + point.count):
                self._names.setdefault(address, []).append(f"{point.name} {point.bits_shown}".rstrip())

    def at(self, first: int, count: int) -> str:
        """List the names at so many addresses, each once."""
        names = (name for address in range(first, first + count) for name in self._names.get(address, ()))
        return ", ".join(dict.fromkeys(names))


def _asked(query: Mapping[str, str], areas: Mapping[Area, Sequence[Range]]) -> dict[str, Any]:
    """Read what the address asks for; without it, the first addresses that exist.

    Raises:
        ProblemError: there is no such area or address.
        Malformed: there is no such type or swap, or it does not fit.
    """
    usual = next((each for each in _FIRST_SHOWN if areas.get(each)), Area.HOLDING)
    name = query.get("area", str(usual))
    if name not in set(Area):
        raise ProblemError(400, f"{name} is not an area; areas are {', '.join(Area)}")
    area = Area(name)
    data_type, swap = query.get("type", ""), query.get("swap", "none")
    if (data_type == "bit") != has_bits(area):
        data_type = ""  # it was chosen for another area
    if has_bits(area):
        swap = "none"
    values_at(area, 0, None, data_type, swap)
    first = areas[area][0][0] if areas.get(area) else 0
    start = whole(query["from"], "from") if query.get("from") else first
    return {"area": area, "from": start, "type": data_type, "swap": swap}


def _address(asked: Mapping[str, Any], start: int | None, *, is_panel: bool) -> str | None:
    """Make the address of the window that begins at `start`."""
    return None if start is None else f"?{urlencode({**asked, 'from': start})}{'&kiosk' if is_panel else ''}"


def _before(ranges: Sequence[Range], start: int) -> int | None:
    """Find where the previous window begins; None if there is nothing before this one."""
    first = ranges[0][0] if ranges else 0
    return max(start - MOST, first) if start > first else None


def _after(ranges: Sequence[Range], start: int, size: int) -> int | None:
    """Find where the next window begins: at the first value of this size that does not fit here; None without any."""
    end = start + MOST
    for first, last in ranges:
        if last >= end:
            return first if first >= end else end - (end - max(first, start)) % size
    return None
