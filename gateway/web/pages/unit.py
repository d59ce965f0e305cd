"""The page of a unit: its values, how fast it answers against its limit, what failed and why."""

from collections.abc import Mapping
from shlex import quote
from typing import Any, Final

from aiohttp import web

from gateway.errors import WrongQuestion
from gateway.lines.counts import RESULTS
from gateway.modbus.codes import Area
from gateway.operator.images.kept import maps_of, mirrors_of
from gateway.operator.operations.answers.status import Status, UnitStatus
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.past.past import past_of
from gateway.operator.status.status import part_of_unit, recent_status
from gateway.operator.status.unit_states import SLOTS, lines_down, rests_ms, states_of
from gateway.operator.trace.failures import failures
from gateway.operator.units.answer_times import answer_times
from gateway.operator.values.complaint import complaint_of, exception_name
from gateway.operator.values.last_values import read_all
from gateway.operator.values.passed import Passed, passed
from gateway.operator.values.requests import ask_for
from gateway.operator.values.steps import Outcome
from gateway.operator.values.unit_values import read, values_at
from gateway.profiles.point import NO_VALUE, Point
from gateway.registers.datatypes import DATA_TYPES, SWAPS
from gateway.web.access.guard import VISITOR
from gateway.web.api.asking import asker_of, unit_in
from gateway.web.front.problems import ProblemError
from gateway.web.pages.addresses import path_of, see_other
from gateway.web.pages.fields import whole
from gateway.web.pages.function_names import function_name
from gateway.web.pages.histogram import plotted
from gateway.web.pages.page import Page, route
from gateway.web.pages.points import points_shown, reference_of
from gateway.web.pages.times import day_and_time
from gateway.web.pages.trend import trend_to_show

#: Points are read at most once in this many seconds, by any number of readers.
READ_EVERY: Final = 1.0
#: What the form for reading says at first, by its fields.
_USUAL: Final[Mapping[str, str]] = {"area": "holding", "start": "0", "count": "10", "type": "", "swap": "none"}
_FAILED: Final = frozenset(RESULTS) - {"ok", "exception", "broadcast"}


class UnitPage(Page):
    """The handlers of `/units/NAME`. NAME is a name or a number."""

    @route("GET", "/units/{unit}")
    async def show(self, request: web.Request) -> web.Response:
        """Show one unit on a line, behind another server or made in Python; all others are shown as images.

        Raises:
            WrongQuestion: there is none of this name.
        """
        unit, visitor = unit_in(request, self._operator), request[VISITOR]
        if not unit.is_asked:
            return see_other(path_of("images", unit))
        try:
            failed, why = failures(self._operator.running, unit.name, visitor.host), ""
        except WrongQuestion as wrong:
            failed, why = (), str(wrong)
        times = answer_times(self._operator.gateway, unit)
        all_states = await recent_status(self._operator)
        status, down = _status_of(unit, all_states), lines_down(all_states)
        trend = await trend_to_show(self._operator, unit, asker_of(request), request.query)
        return await self._renderer.page(
            "unit.html",
            request,
            in_thread=lambda: {"trend": trend()},
            unit=unit,
            status=status,
            made=await part_of_unit(self._operator.gateway, unit.unit, unit.name) if unit.kind == "custom" else None,
            state=None if status is None else states_of([status], past_of(self._operator, SLOTS), down)[status.name],
            times=[(each, plotted(each)) for each in times],
            function_name=function_name,
            exception_name=exception_name,
            clock=day_and_time,
            calibrate=f"modbus-gateway calibrate {quote(unit.name)}" if any(each.responses for each in times) else "",
            failures=failed,
            why_no_failures=why,
            kinds=_kinds(status),
            blocked=_blocked(status),
            longest_limit=max((each.limit_ms or 0.0 for each in times), default=0.0),
            mirrors=mirrors_of(self._operator.gateway, unit.key),
            maps=maps_of(self._operator.gateway, unit.name),
            passed=() if unit.points else await passed(self._operator, unit, asker_of(request)),
            registers=_registers,
            **points_shown(self._operator, self._rights, unit, request),
            **_form(_USUAL),
        )

    @route("POST", "/units/{unit}/points")
    async def read_points(self, request: web.Request) -> web.Response:
        """Read all points, unless they were read within a second, and return to the page.

        Raises:
            WrongQuestion: there is no such unit, or nothing could be read.
        """
        unit = unit_in(request, self._operator)
        await read_all(self._operator, unit, asker_of(request), READ_EVERY)
        return see_other(f"{path_of('units', unit)}#points")

    @route("GET", "/units/{unit}/values")
    async def read_values(self, request: web.Request) -> web.Response:
        """Read what the form asks for; an exception of the unit is shown on the page.

        Raises:
            ProblemError: the page of another site asks, or there is no such area, address or count.
            WrongQuestion: there is no such unit, or the type or swap does not fit.
        """
        if request.headers.get("Sec-Fetch-Site") == "cross-site":
            raise ProblemError(403, "pages of other sites get no answer")
        unit, visitor = unit_in(request, self._operator), request[VISITOR]
        asked = {**_USUAL, **{name: request.query.get(name, usual) for name, usual in _USUAL.items()}}
        area, points = _asked_for(unit, asked)
        outcome, why = Outcome(), None
        try:
            outcome = await read(unit, points, ask_for(self._operator, unit.key, asker_of(request)))
        except WrongQuestion as wrong:
            why = complaint_of(wrong)
        values = [(each, reference_of(each.point)) for each in outcome.readings]
        return await self._renderer.page(
            "values.html",
            request,
            unit=unit,
            area=area,
            values=values,
            elapsed_ms=outcome.elapsed_ms,
            why=why,
            no_value=NO_VALUE,
            rests_ms=rests_ms(unit, await recent_status(self._operator)) if why else 0.0,
            **_form(asked),
            **self._rights.of(unit, visitor).as_content(),
        )


def _status_of(unit: UnitPicture, status: Status) -> UnitStatus | None:
    return next((each for each in status.units if each.unit == unit.unit and each.name == unit.name), None)


def _kinds(status: Any) -> list[tuple[str, int]]:
    """List what failed and how often, the most frequent first."""
    if status is None:
        return []
    counts = {name: getattr(status.counts, name) for name in _FAILED}
    return sorted(((name, count) for name, count in counts.items() if count), key=lambda each: (-each[1], each[0]))


def _registers(passed: Passed) -> str:
    """Write the coils or registers that passed as numbers."""
    width = len(passed.items) // passed.span.count
    items = (passed.items[at : at + width] for at in range(0, len(passed.items), width))
    return " ".join(str(int.from_bytes(item, "big")) for item in items)


def _blocked(status: Any) -> int:
    """Count the requests that were not sent for each one without a valid response, rounded."""
    if status is None:
        return 0
    causes = status.counts.timeout + status.counts.bad_frame + status.counts.ambiguous
    return round(status.counts.overdue / causes) if causes else 0


def _form(asked: Mapping[str, str]) -> dict[str, Any]:
    return {"asked": asked, "areas": tuple(map(str, Area)), "types": tuple(DATA_TYPES), "swaps": tuple(SWAPS)}


def _asked_for(unit: UnitPicture, asked: Mapping[str, str]) -> tuple[Area, list[Point]]:
    """List the values that a form asks for.

    Raises:
        ProblemError: there is no such area, address or count.
        Malformed: there is no such type or swap, or it does not fit.
    """
    if asked["area"] not in set(Area):
        raise ProblemError(400, f"{asked['area']} is not an area; areas are {', '.join(Area)}")
    area, start, count = Area(asked["area"]), whole(asked["start"], "start"), whole(asked["count"], "count")
    one = values_at(area, start, None, asked["type"], asked["swap"], unit.wide)[0]
    return area, values_at(area, start, start + count * one.count - 1, asked["type"], asked["swap"], unit.wide)
