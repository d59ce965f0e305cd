"""Records of the trace as tables show them, with words for what was asked and what came of it."""

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

from gateway.operator.operations.answers.trace import Fact
from gateway.operator.trace.meanings import FEW, Points
from gateway.trace.pdus import frame_in_words, request_in_words, response_in_words
from gateway.web.text.words import N_

#: What was heard, by its owner, if it is not only foreign traffic.
_HEARD: Final = {
    "noise": N_("noise"),
    "a damaged frame": N_("broken frame"),
    "a late response": N_("late response"),
}
_ABSENT: Final = dict.fromkeys(
    (
        *("unit", "name", "client", "address", "request", "response", "heard", "frame", "reason"),
        *("device", "sources"),
        *("wait_ms", "elapsed_ms", "limit_ms"),
    )
)


def row(fact: Fact, points: Points) -> dict[str, Any]:
    """Make the row of a fact; the template adds words in the language of the page."""
    clock = datetime.fromtimestamp(fact["time"]).astimezone().time().isoformat("milliseconds")
    took = {"elapsed_ms": 1000 * (fact["time"] - fact["received"])} if fact["kind"] == "answered" else {}
    return {
        **_ABSENT,
        **took,
        **fact,
        "clock": clock,
        "state": state(fact),
        "json": json.dumps(points.beside(fact), ensure_ascii=False),
        "meant": points.meant(fact)[0],
        "few": FEW,
    }


def state(fact: Mapping[str, Any]) -> str:
    """Classify the transaction: see `transactions.js`."""
    kind, response = fact["kind"], fact.get("response")
    if kind == "answered":
        return (N_("exception") if response[0] >= "8" else N_("answered")) if response else N_("not answered")
    if kind == "heard":
        return _HEARD.get(fact["owner"], N_("foreign traffic"))
    if kind != "exchange":
        return N_("not sent") if kind == "refused" else N_("port")
    if fact.get("heard"):
        return N_("broken frame")
    if fact.get("result", "timeout" if fact.get("sent_again") else ""):
        return N_("time-out") if fact.get("result", "timeout") == "timeout" else N_("no valid response")
    return N_("exception") if response and response[0] >= "8" else N_("ok")


def asked(row: Mapping[str, Any], word: Any) -> str:
    """Write what was asked; empty if the visitor may not see it, or nothing was asked."""
    text = row.get("request") or (row.get("frame") if row["kind"] == "heard" and row["owner"] != "noise" else "")
    data = bytes.fromhex(text or "")
    if row["kind"] == "heard":
        is_request = row["owner"] in ("another's request", "an echo")
        return frame_in_words(data[1:], is_request=is_request, word=word) if len(data) > 1 else ""
    return request_in_words(data, word) if data else ""


def outcome(row: Mapping[str, Any], word: Any) -> str:
    """Write what came of it."""
    owner, result = row.get("owner"), row.get("result")
    if row["kind"] == "heard":
        return word(owner) if owner != "noise" else row["frame"] or ""
    if row["response"]:
        return response_in_words(bytes.fromhex(row["request"]), bytes.fromhex(row["response"]), word)
    return row["reason"] or (word(result) if row["kind"] == "refused" else "")
