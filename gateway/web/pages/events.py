"""The page of the events: what is still wrong, since when, and what has happened, as selected by the address."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final
from urllib.parse import urlencode

from aiohttp import web

from gateway.config.problem import WrongValue
from gateway.config.values.duration import parse_duration
from gateway.errors import Malformed, WrongQuestion
from gateway.events import Level
from gateway.listeners.sockets import split_host
from gateway.observe.last_events import LastEvent
from gateway.operator.asked import ToList
from gateway.operator.happened import last_events, rfc_3339
from gateway.operator.operator import Operator
from gateway.operator.parameters import read_parameters
from gateway.operator.units import units_of
from gateway.timing.history import STEP, Slot
from gateway.web.access.guard import Need
from gateway.web.front.problems import Handler
from gateway.web.pages.renderer import Renderer
from gateway.web.pages.situation import Situation, Situations
from gateway.web.pages.times import day_and_time
from gateway.web.pages.traffic import choice
from gateway.web.pages.troubles import FULL, Trouble, worst_first
from gateway.web.pages.unit_states import is_failing

#: This many events are on the page.
MOST_ROWS: Final = 200
#: What selects among them; periods to choose from, and how the severities look.
CHOICES: Final = ("since", "level", "line", "unit", "client")
PERIODS: Final = ("1h", "24h", "168h")
_LOOKS: Final = {"info": "not-asked", "warning": "failing", "error": "down"}


class EventsPage:
    """The handler of `/events`."""

    def __init__(self, operator: Operator, situations: Situations, renderer: Renderer) -> None:
        self._operator = operator
        self._situations = situations
        self._renderer = renderer

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """List the routes: method, path, handler, and what it needs."""
        return [("GET", "/events", self.show, "page")]

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

        def content() -> Mapping[str, Any]:
            return {"wrong": [(each, began(each, operator, seen)) for each in worst_first(seen.troubles)]}

        return await self._renderer.page(
            "events.html",
            request,
            content,
            rows=[_row(each, frozenset(lines), with_page) for each in reversed(found[-MOST_ROWS:])],
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
        return _since(seen, lambda slot: name in slot.units and is_failing(slot.units[name]))
    if trouble.kind == "full":
        return _since(seen, lambda slot: name in slot.lines and slot.lines[name].busy_share >= FULL)
    return None


def _since(seen: Situation, is_wrong: Callable[[Slot], bool]) -> float | None:
    """Return the beginning of the last slots in which something is wrong; the present one may be too short to tell."""
    slots = seen.past.slots
    end = len(slots) - (not slots or slots[-1] is None or not is_wrong(slots[-1]))
    start = end
    while start and (slot := slots[start - 1]) is not None and is_wrong(slot):
        start -= 1
    return float((seen.past.first + start) * STEP) if start < end else None


def _asked(chosen: Mapping[str, str]) -> ToList:
    """Read what the address selects.

    Raises:
        WrongQuestion: it is not understood.
    """
    others = {name: text for name, text in chosen.items() if name != "since"}
    try:
        since = {"since": str(parse_duration(chosen["since"]))} if "since" in chosen else {}
    except WrongValue as wrong:
        raise Malformed(f"since: {wrong}") from None
    return read_parameters(ToList, {**others, **since}, is_text=True)


def _row(event: LastEvent, lines: frozenset[str], units: frozenset[str]) -> Mapping[str, Any]:
    fields, level = event.fields, Level(event.level).name.lower()
    device = fields.get("device") or fields.get("image") or ""
    return {
        "event": event,
        "level": level,
        "look": _LOOKS.get(level, ""),
        "line": fields.get("line", ""),
        "has_line": fields.get("line") in lines,
        "unit": device or fields.get("unit", ""),
        "has_unit": device in units,
        "client": split_host(client) if (client := str(fields.get("client", ""))) else "",
    }
