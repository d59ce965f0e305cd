"""The page of the traffic: the last transactions of all lines, as the address chooses among them."""

import json
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final
from urllib.parse import urlencode

from aiohttp import web

from gateway.errors import WrongQuestion
from gateway.listeners.sockets import host_of
from gateway.trace.pdus import FUNCTIONS, frame_in_words, request_in_words, response_in_words
from gateway.trace.results import RESULTS
from gateway.web.answers import Answers
from gateway.web.api import which
from gateway.web.guard import VISITOR, Need
from gateway.web.pages.shown_lines import shown_lines
from gateway.web.problems import Handler, ProblemError
from gateway.web.renderer import Renderer

#: So many transactions are on the page as the server makes it; a script adds more as they come.
MOST_ROWS: Final = 50
#: What chooses among them, and how long a capture file reaches back, in seconds.
CHOICES: Final = ("line", "unit", "function", "client", "result")
_CAPTURED: Final = "300"
#: What has no name of its own in the records.
_OWNERS: Final = {"noise": "noise", "a damaged frame": "broken frame", "a late response": "late response"}
_ABSENT: Final = dict.fromkeys(
    (
        *("unit", "name", "client", "address", "request", "response", "heard", "frame", "reason"),
        *("wait_ms", "elapsed_ms", "limit_ms"),
    )
)


class TrafficPage:
    """The handler of `/traffic`."""

    def __init__(self, answers: Answers, renderer: Renderer) -> None:
        self._answers = answers
        self._renderer = renderer

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """Method, path, handler, and what it needs."""
        return [("GET", "/traffic", self.show, "page")]

    async def show(self, request: web.Request) -> web.Response:
        """The last transactions that the address chooses."""
        chosen = {name: text for name in CHOICES if (text := request.query.get(name, "").strip())}
        try:
            facts, why = await self._answers.latest(which(chosen, usual=0), request[VISITOR].host, MOST_ROWS), ""
        except (ProblemError, WrongQuestion) as wrong:
            facts, why = (), str(wrong)
        status = await self._answers.status()
        lines = {each.name: each for each in shown_lines(status)}
        return await self._renderer.page(
            "traffic.html",
            request,
            rows=[_row(fact) for fact in facts],
            why=why,
            chosen=dict.fromkeys(CHOICES, "") | chosen,
            lines=lines,
            modes={name: (each.mode, each.baud, each.format) for name, each in lines.items()},
            units=[(each.unit, each.name) for each in self._answers.units()],
            functions=FUNCTIONS,
            clients=sorted({host_of(each.client) for each in status.clients}),
            results=RESULTS,
            query=urlencode(chosen),
            capture=urlencode({**chosen, "seconds": _CAPTURED}),
            request_in_words=_request_in_words,
            outcome_in_words=_outcome_in_words,
        )


def _row(fact: Mapping[str, Any]) -> dict[str, Any]:
    """A fact for the template, which says the rest in the language of the page."""
    clock = datetime.fromtimestamp(fact["time"]).astimezone().time().isoformat("milliseconds")
    return {**_ABSENT, **fact, "clock": clock, "state": _state(fact), "json": json.dumps(fact, ensure_ascii=False)}


def _state(fact: Mapping[str, Any]) -> str:
    """What the transaction is called: see `transactions.js`."""
    kind, response = fact["kind"], fact.get("response")
    if kind == "answered":
        return "answered" if response else "not answered"
    if kind == "heard":
        return _OWNERS.get(fact["owner"], "foreign traffic")
    if kind != "exchange":
        return {"refused": "not sent"}.get(kind, "port")
    if fact.get("heard"):
        return "broken frame"
    if fact.get("result", "timeout" if fact.get("sent_again") else ""):
        return "time-out" if fact.get("result", "timeout") == "timeout" else "no valid response"
    return "exception" if response and response[0] >= "8" else "ok"


def _request_in_words(row: Mapping[str, Any], word: Any) -> str:
    """What was asked; empty where the visitor may not see it, or nothing was asked."""
    text = row.get("request") or (row.get("frame") if row["kind"] == "heard" and row["owner"] != "noise" else "")
    data = bytes.fromhex(text or "")
    if row["kind"] == "heard":
        is_request = row["owner"] in ("another's request", "an echo")
        return frame_in_words(data[1:], is_request=is_request, word=word) if len(data) > 1 else ""
    return request_in_words(data, word) if data else ""


def _outcome_in_words(row: Mapping[str, Any], word: Any) -> str:
    """What came of it."""
    if row["kind"] == "heard":
        return word(_OWNERS.get(row["owner"], row["owner"])) if row["owner"] != "noise" else row["frame"] or ""
    if row["response"]:
        return response_in_words(bytes.fromhex(row["request"]), bytes.fromhex(row["response"]), word)
    return row["reason"] or (word(row["result"]) if row["kind"] == "refused" else "")
