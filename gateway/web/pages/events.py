"""The page of the events: what is still wrong, since when, and what has happened, as selected by the address."""

from collections.abc import Callable, Mapping
from typing import Any, Final
from urllib.parse import urlencode

from aiohttp import web

from gateway.clock.times import rfc_3339
from gateway.config.plan.settings import Plan
from gateway.config.problem import WrongValue
from gateway.config.values.duration import parse_duration
from gateway.errors import Malformed, WrongQuestion
from gateway.events import Level
from gateway.listeners.hosts import split_host
from gateway.observe.last_events import LastEvent
from gateway.operator.operations.answers.trouble import FULL, Trouble, worst_first
from gateway.operator.operations.asked import ToList
from gateway.operator.operations.parameters import read_parameters
from gateway.operator.operator import Operator
from gateway.operator.past.events import last_events
from gateway.operator.status.unit_states import is_failing
from gateway.operator.units.units import names, units_of
from gateway.timing.history import STEP, Slot
from gateway.web.pages.page import Page, route
from gateway.web.pages.situation import Situation
from gateway.web.pages.times import day_and_time
from gateway.web.pages.traffic import choice

#: This many events are on the page.
MOST_ROWS: Final = 200
#: What selects among them; periods to choose from, and how the severities look.
CHOICES: Final = ("since", "level", "line", "unit", "client")
PERIODS: Final = ("1h", "24h", "168h")
_LOOKS: Final = {"info": "not-asked", "warning": "failing", "error": "down"}


class EventsPage(Page):
    """The handler of `/events`."""

    @route("GET", "/events")
    async def show(self, request: web.Request) -> web.Response:
        """Show what is wrong, and the last events that the address selects."""
        chosen = {name: text for name in CHOICES if (text := request.query.get(name, "").strip())}
        try:
            found, why = last_events(self._operator, _asked(chosen)), ""
        except WrongQuestion as wrong:
            found, why = [], str(wrong)
        operator, seen, units = self._operator, await self._situations.now(), units_of(self._operator)
        lines = [part.name for part in operator.gateway.parts]
        with_page = frozenset(unit.name for unit in units)
        known = _Names(operator.gateway.plan)

        def content() -> Mapping[str, Any]:
            return {"still": [(each, began(each, operator, seen)) for each in worst_first(seen.troubles)]}

        return await self._renderer.page(
            "events.html",
            request,
            content,
            rows=[_row(each, known) for each in reversed(found[-MOST_ROWS:])],
            left_out=max(0, len(found) - MOST_ROWS),
            why=why,
            chosen=dict.fromkeys(CHOICES, "") | chosen,
            query=urlencode(chosen),
            periods=PERIODS,
            lines=lines,
            units=[choice(each) for each in units],
            with_page=with_page,
            rfc_3339=rfc_3339,
            day_and_time=day_and_time,
        )


def began(trouble: Trouble, operator: Operator, seen: Situation) -> float | None:
    """Find since when something is wrong, in seconds since 1970: by an event, else by the history; None if unknown."""
    name = trouble.name
    at_events = {"down": f"line {name}" if trouble.page else name, "resting": f"unit {name}", "fix": name}
    if trouble.kind in at_events and (trouble.kind != "fix" or not trouble.page):
        return operator.events.began(at_events[trouble.kind])
    if trouble.kind == "failing":
        return _since(operator, seen, lambda slot: name in slot.units and is_failing(slot.units[name]))
    if trouble.kind == "full":
        return _since(operator, seen, lambda slot: name in slot.lines and slot.lines[name].busy_share >= FULL)
    return None


def _since(operator: Operator, seen: Situation, is_wrong: Callable[[Slot], bool]) -> float | None:
    """Return the beginning of the last slots in which something is wrong; the present one may be too short to tell."""
    slots = seen.past.slots
    end = len(slots) - (not slots or slots[-1] is None or not is_wrong(slots[-1]))
    start = end
    while start and (slot := slots[start - 1]) is not None and is_wrong(slot):
        start -= 1
    begun, ran_since = float((seen.past.first + start) * STEP), operator.clock() - seen.up_s
    if start == end:
        return None
    return ran_since if begun < ran_since < begun + STEP else begun


def _asked(chosen: Mapping[str, str]) -> ToList:
    """Read what the address selects.

    Raises:
        WrongQuestion: it is not understood.
    """
    others = {name: text for name, text in chosen.items() if name != "since"}
    try:
        since = {"since": f"{parse_duration(chosen['since']):.0f}"} if "since" in chosen else {}
    except WrongValue as wrong:
        raise Malformed(f"since: {wrong}") from None
    return read_parameters(ToList, {**others, **since}, is_text=True)


class _Names:
    """The names of lines and units that have pages."""

    def __init__(self, plan: Plan) -> None:
        self.units = names(plan)
        self._of_one_line = {listener.name for listener in plan.listeners if listener.only}

    def unit_of(self, fields: Mapping[str, Any]) -> str:
        """Return the name of the unit that an event is about, or its number; empty if it is about none."""
        number = fields.get("unit", "")
        named = fields.get("device") or fields.get("image")
        if named or "client" not in fields or fields.get("listener") in self._of_one_line:
            return str(named or number)
        return self.units.get(number, str(number))


def _row(event: LastEvent, known: _Names) -> Mapping[str, Any]:
    level = Level(event.level).name.lower()
    client = str(event.fields.get("client", ""))
    return {
        "event": event,
        "level": level,
        "look": _LOOKS.get(level, ""),
        "line": event.fields.get("line", ""),
        "unit": known.unit_of(event.fields),
        "client": split_host(client) if client else "",
    }
