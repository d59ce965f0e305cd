"""Writing from pages: a form, a page that shows old and new and asks, and the result.

What a user has confirmed is sent once, however often the form arrives: each question has an identifier of its own, and
is answered once. All pages are answers to GET, so that reloading one sends nothing.
"""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from aiohttp import web

from gateway.errors import DoesNotFit, ExceptionCode, WrongQuestion
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.status.status import recent_status
from gateway.operator.status.unit_states import rests_ms
from gateway.operator.units.reached import target
from gateway.operator.units.units import picture
from gateway.operator.values.complaint import Complaint, complaint_of
from gateway.operator.values.last_values import forget_values
from gateway.operator.values.requests import Ask, ask_for
from gateway.operator.values.steps import Failure, writing
from gateway.operator.values.unit_values import assigned, carried_out, point_named, read, values_at
from gateway.profiles.point import Point
from gateway.profiles.profile import width_at
from gateway.profiles.writing import Write
from gateway.registers.datatypes import registers_of
from gateway.registers.items import REGISTER, WRITERS, reference
from gateway.web.access.guard import VISITOR, Visitor
from gateway.web.api.asking import asker_for, asker_of, unit_in
from gateway.web.front.problems import ProblemError
from gateway.web.front.turns import is_there
from gateway.web.pages.addresses import page_of, path_of, see_other
from gateway.web.pages.fields import whole
from gateway.web.pages.function_names import function_name
from gateway.web.pages.page import Page, Shown, route
from gateway.web.pages.questions import PATIENCE, Question, Questions, Result

#: If a user confirms a write and closes the page at once, the write is still sent within this time, in seconds.
GRACE: Final = 2.0
#: After these the unit may have acted all the same, but not with these results: then nothing was sent.
_UNCERTAIN: Final = frozenset({ExceptionCode.ACKNOWLEDGE, ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND})
_NOT_SENT: Final = frozenset({"overdue", "resting", "echo_suspected", "stale"})
_CHANGED: Final = "the config has changed since this was asked: nothing was sent; begin again at the page of the unit"


#: Why something could not be read; None if it could.
_Why = Complaint | str | None


class WritePages(Page):
    """The handlers of `/units/NAME/writes`."""

    def __init__(self, shown: Shown) -> None:
        super().__init__(shown)
        self._questions = Questions()

    @route("POST", "/units/{unit}/writes", "operator")
    async def ask(self, request: web.Request) -> web.Response:
        """Take the form: the value of a point, or values from an address on. Nothing is written yet.

        Raises:
            ProblemError: nothing may be written, or a field is invalid.
            WrongQuestion: there is no such unit or point, or the values do not fit there.
        """
        if not self._rights.may_write:
            raise ProblemError(403, "nothing is written over HTTP without write = true in [web]")
        form = {name: str(text) for name, text in (await request.post()).items()}
        unit, visitor = unit_in(request, self._operator), request[VISITOR]
        new = assigned(unit, *_wanted(unit, form))
        if not new.needs_scales:
            self._require_right(unit, visitor, new.prepared()[1])
        expected = target(self._operator.gateway, unit.key)
        ask = ask_for(self._operator, unit.key, asker_of(request))
        before, why = await _read(unit, new.points, ask, is_required=new.needs_scales)
        readings, write = new.prepared(before)
        self._require_right(unit, visitor, write)
        wanted = tuple(replace(each, before=items) for each, items in zip(readings, before, strict=True))
        now = asyncio.get_running_loop().time()
        identifier = self._questions.put(Question(unit, expected, visitor.csrf, new, wanted, write, why, now), now)
        return see_other(f"{path_of('units', unit)}/writes/{identifier}")

    def _require_right(self, unit: UnitPicture, visitor: Visitor, write: Write) -> None:
        if not self._operator.router("web").rights.permits(visitor.host, unit.key, write.pdu):
            where = f"{write.span.area} {write.span.addresses}"
            raise ProblemError(403, f"[[access]] does not let {visitor.client} write {where}", exception=1)

    @route("GET", "/units/{unit}/writes/{id}")
    async def show(self, request: web.Request) -> web.Response:
        """Show old and new values with the question, or its result."""
        question = self._question(request)
        if question is None:
            page = await self._renderer.page(
                "write.html", request, question=None, unit=unit_in(request, self._operator), back="/"
            )
            page.set_status(404)
            return page
        unit = question.unit
        return await self._renderer.page(
            "write.html",
            request,
            question=question,
            unit=unit,
            back=page_of(unit),
            rows=[_row(question, at) for at in range(len(question.wanted))],
            function=question.write.pdu[0],
            function_name=function_name,
            patience=int(PATIENCE),
            rests_ms=rests_ms(unit, await recent_status(self._operator)),
        )

    @route("POST", "/units/{unit}/writes/{id}", "operator")
    async def confirm(self, request: web.Request) -> web.Response:
        """Send it, unless it was sent already; a second request waits for the result of the first."""
        question = self._question(request)
        if question is not None and self._rights.may_write:
            waits = partial(is_there, request)
            question.waiting.append(waits)
            try:
                async with question.turn:
                    if not question.is_sent:
                        question.is_sent = True
                        question.result = await self._send(question, request[VISITOR])
            finally:
                question.waiting.remove(waits)
        return see_other(request.path)

    async def _send(self, question: Question, visitor: Visitor) -> Result:
        loop = asyncio.get_running_loop()
        until = loop.time() + GRACE

        def is_awaited() -> bool:
            return loop.time() < until or any(waits() for waits in question.waiting)

        unit = question.unit
        if not self._is_as_asked(question):
            return Result(_CHANGED, 0.0)
        ask = ask_for(self._operator, unit.key, asker_for(visitor, is_awaited))
        try:
            outcome = await carried_out(writing(question.new), ask)
        except DoesNotFit as wrong:  # the scale has changed
            return Result(str(wrong), 0.0)
        finally:
            forget_values(self._operator, unit)
        question.write = outcome.write or question.write
        answer = outcome.answers[-1]
        for failure in outcome.failures:
            return Result(answer.complaint, answer.elapsed_ms, may_have_acted=_may_have_acted(failure))
        after, why = await _read(unit, question.new.points, ask)
        return Result(None, answer.elapsed_ms, tuple(after), why)

    def _is_as_asked(self, question: Question) -> bool:
        """Return whether the same unit still answers, and its points still mean the same."""
        gateway, unit = self._operator.gateway, question.unit
        try:
            return picture(self._operator, unit.name) == unit and target(gateway, unit.key) is question.target
        except WrongQuestion:
            return False

    def _question(self, request: web.Request) -> Question | None:
        """Find the question that the address names, if this visitor has asked it."""
        owner, now = request[VISITOR].csrf, asyncio.get_running_loop().time()
        found = self._questions.find(request.match_info["id"], now)
        return found if found is not None and owner and found.owner == owner else None


async def _read(
    unit: UnitPicture, points: Sequence[Point], ask: Ask, *, is_required: bool = False
) -> tuple[list[bytes | None], _Why]:
    """Read the items of points, or return why there are none.

    Raises:
        UnitFailed: it `is_required`, and there are none.
    """
    if any(point.write == "only" for point in points) and not is_required:
        return [None] * len(points), None
    try:
        outcome = await read(unit, points, ask)
    except WrongQuestion as wrong:
        if is_required:
            raise
        return [None] * len(points), complaint_of(wrong)
    return [each.items for each in outcome.readings], None


@dataclass(frozen=True, slots=True)
class ShownWrite:
    """One value of a question as text: `old` and `after` are None where they are not known."""

    point: Point
    reference: str
    new: str
    old: str | None
    after: str | None


def _row(question: Question, at: int) -> ShownWrite:
    wanted = question.wanted[at]
    point, result = wanted.point, question.result
    after = result.after[at] if result is not None and result.after else None
    return ShownWrite(
        point,
        reference(point.area, point.address) + point.bits_shown,
        wanted.text,
        _text(point, wanted.before),
        _text(point, after),
    )


def _may_have_acted(failure: Failure) -> bool:
    return bool(failure.function) and failure.answer.exception in _UNCERTAIN and failure.answer.result not in _NOT_SENT


def _text(point: Point, items: bytes | None) -> str | None:
    return None if items is None else point.show(point.value(items))


def _wanted(unit: UnitPicture, form: dict[str, str]) -> tuple[list[Point], list[str]]:
    """Find the points and values that a form names, as `modbus-gateway write` understands them.

    Raises:
        ProblemError: a field is invalid.
        WrongQuestion: the unit has no such point, or the type or swap does not fit.
    """
    value = form.get("value", "")
    if form.get("point"):
        return [point_named(unit, form["point"])], [value]
    if form.get("area") not in set(WRITERS):
        raise ProblemError(422, f"{form.get('area', '')} cannot be written; coils and holding can")
    area, start, data_type = Area(form["area"]), whole(form.get("address", ""), "address"), form.get("type", "")
    values = [value] if data_type == "string" else value.replace(",", " ").split()
    if not values:
        raise ProblemError(422, "a value is missing")
    swap, width = form.get("swap", "none"), width_at(unit.wide, Span(area, start, 1)) or REGISTER
    length = -(-len(value.encode()) // width) if data_type == "string" else 0
    count = max(length, 1) if data_type == "string" else len(values) * registers_of(data_type, width)
    return values_at(area, start, start + count - 1, data_type, swap, unit.wide), values
