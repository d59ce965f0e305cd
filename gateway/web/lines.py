"""What the pages show of lines and other servers: who is on them, and what has just happened there."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from gateway.web.answers import Answers, Status, Which

#: The table without JavaScript: so many transactions of the last seconds at most.
MOST_FACTS: Final = 20
_LOOK_BACK: Final = 10
_ABSENT: Final = dict.fromkeys(("result", "reason", "response", "request", "wait_ms", "elapsed_ms", "limit_ms"))


@dataclass(frozen=True, slots=True)
class PageLine:
    """A line, or another server, as a page shows it. `units` are numbers and names; another server has no `baud`."""

    name: str
    mode: str
    baud: int
    format: str
    port: str
    settings: str
    busy_share: float | None
    units: tuple[tuple[int, str], ...]
    status: Any


def page_lines(status: Status) -> Iterator[PageLine]:
    """All of them, in the order of the config."""
    for each in (*status.lines, *status.servers):
        settings = f"{each.mode.upper()} {each.baud} {each.format}"
        busy = getattr(each, "busy_share", None)
        units = _units_on(status, each.name)
        yield PageLine(each.name, each.mode, each.baud, each.format, each.port, settings, busy, units, each)
    for each in status.upstreams:
        yield PageLine(each.name, "tcp", 0, "", each.to, "Modbus TCP", None, _units_on(status, each.name), each)


async def last_facts(answers: Answers, line: str, host: str) -> Sequence[dict[str, Any]]:
    """The last transactions on a line that a reader at this address may see, the newest first.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line.
    """
    facts = [json.loads(text) for text in await answers.trace(Which(_LOOK_BACK, line), host).next(0)]
    shown = [fact for fact in facts if fact["kind"] in ("exchange", "answered", "refused")]
    return [{**_ABSENT, **fact, "clock": _clock(fact["time"])} for fact in reversed(shown[-MOST_FACTS:])]


def _units_on(status: Status, name: str) -> tuple[tuple[int, str], ...]:
    return tuple((each.unit, each.name) for each in status.units if each.line == name)


def _clock(time: float) -> str:
    return datetime.fromtimestamp(time).astimezone().time().isoformat("milliseconds")
