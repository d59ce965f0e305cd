"""What became of a failed request, in sentences, for `trace --why` and the page of a unit."""

import textwrap
from collections.abc import Mapping
from datetime import datetime
from shlex import quote
from typing import Any, Final, Literal

from gateway.modbus.explain import Mode, explain
from gateway.modbus.pdu import parse_sent
from gateway.operator.trace.capture import count_frames, heard_frame
from gateway.trace.pdus import exception_in_words, request_in_words

Story = Mapping[str, Any]


def clock(time: float) -> str:
    """Format a time in seconds since 1970 as the local time of day, to the millisecond."""
    return datetime.fromtimestamp(time).astimezone().time().isoformat("milliseconds")


def told(story: Story, width: int = 80) -> str:
    """Write one story: a heading, and below it what happened."""
    names = ": ".join(story[each] for each in ("name", "device") if story.get(each))
    unit = f"unit {story['unit']}" + (f" ({names})" if names else "")
    asked = request_in_words(bytes.fromhex(story["request"]))
    heading = f"{clock(story['received'])}  {story['client']} asked {unit}: {asked}"
    text = textwrap.fill(sentences(story), width, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
    return f"{heading}\n{text}"


def sentences(story: Story) -> str:
    """Write what happened in sentences, and last the exception that was the result, even if no client got it."""
    parts = _sent(story) if story["kind"] == "exchange" else _not_sent(story)
    return " ".join([*(part for part in parts if part), _outcome(story)])


def _sent(story: Story) -> list[str]:
    again = " once more" if story.get("retries") else ""
    where = f"{'on' if _is_line(story) else 'through'} {_way(story)} to address {story['address']}"
    waited = _waited(story)
    sent = (
        f"{waited}and was sent{again} {where} at {clock(story['sent'])}." if waited else f"Sent{again} {where} at once."
    )
    limit, elapsed = _milliseconds(story["limit_ms"]), _milliseconds(story["elapsed_ms"])
    result = story.get("result")
    if result is None:
        return [sent, f"{_who_answered(story)} answered with an exception after {elapsed}; it was passed on unchanged."]
    if result == "bad_frame":
        return [sent, _bad_frame(story, limit), _window(story)]
    what = _AFTER_SENDING.get(result, "It failed: {reason}.").format(
        limit=limit, elapsed=elapsed, reason=story.get("reason") or result
    )
    return [sent, what, _window(story)]


def _is_line(story: Story) -> bool:
    """Return whether the request goes to a line, and not to another server. Earlier versions do not say."""
    return story.get("mode") != "tcp"


def _way(story: Story) -> str:
    """Name the line, server or site: `line hall`."""
    if story.get("site"):
        return f"site {story['site']}"
    return f"{'line' if _is_line(story) else 'server'} {story['line']}"


def _who_answered(story: Story) -> str:
    if _is_line(story):
        return "The unit itself"
    way = _way(story)
    return f"{way[0].upper()}{way[1:]} (the unit there, or the rights there)"


def _window(story: Story) -> str:
    if not story.get("late_until"):
        return ""
    return f"A late response was awaited until {clock(story['late_until'])} (late window)."


def _bad_frame(story: Story, limit: str) -> str:
    heard = bytes.fromhex(story["heard"])
    is_text = story.get("mode") == "ascii" and heard.isascii()
    shown = heard.decode("ascii").strip() if is_text else story["heard"]
    why = _explained(story, heard) or _why_not_valid(heard, story.get("mode", "rtu"))
    return f"What came within {limit} was no valid response: {shown} ({why})."


def _explained(story: Story, heard: bytes) -> str:
    """Explain why the bytes are not the response; empty if that is unclear, or the line is gone."""
    mode: Mode | Literal[""] = story.get("mode", "rtu")
    return explain(parse_sent(bytes.fromhex(story["request"])), story["address"] or None, heard, mode) if mode else ""


def _why_not_valid(heard: bytes, mode: str) -> str:
    count = count_frames(heard, mode)
    if count > 1:
        return f"none of these {count} frames is the response to this request"
    is_damaged = not count and heard_frame(heard, mode)[1]
    return "it is damaged: no check sum fits" if is_damaged else "it is not the response to this request"


def _not_sent(story: Story) -> list[str]:
    result = story["result"]
    if not story.get("line") and result in _OF_LINES:
        return _made_in_python(story)
    if result in ("timeout", "line_lost"):
        why = "the port was lost" if result == "line_lost" else "there was no time left for that"
        return [f"It had been sent without a response, and was to be sent once more, but {why}."]
    if result == "line_down":
        what = _line_down(story)
    elif result == "stale":
        what = _stale(story)
    else:
        until = f" until {clock(story['until'])}" if story.get("until") else ""
        own = {"until": until, "way": _way(story), "waited": _waited(story), "reason": story["reason"] or result}
        what = _NOT_SENT.get(result, "It was refused: {reason}.").format_map({**story, **own})
    return [what, "Nothing was sent."]


def _made_in_python(story: Story) -> list[str]:
    """Say why a unit made in Python, the only one without a line that fails so, did not answer."""
    if story["result"] in ("timeout", "line_lost"):
        return [f"It failed: {story['reason']}.", "It was cancelled; the unit may have acted."]
    return [f"It was refused: {story['reason']}.", "The unit was not asked."]


def _waited(story: Story) -> str:
    """Write `Waited 40 ms behind unit 43 (press) `; empty if it did not have to wait."""
    if story["wait_ms"] < 1:
        return ""
    return f"Waited {_milliseconds(story['wait_ms'])}{_behind(story)} "


def _behind(story: Story) -> str:
    units = story.get("behind") or ()
    if not units:
        return ""
    named = [f"{each['unit']}" + (f" ({each['name']})" if each["name"] else "") for each in units[:4]]
    more = f" and {len(units) - 4} more" if len(units) > 4 else ""
    count = story.get("behind_count", len(units))
    requests = f", {count} requests" if count > len(units) else ""
    return f" behind unit{'s' if len(units) > 1 else ''} {', '.join(named)}{more}{requests}"


def _outcome(story: Story) -> str:
    code = story.get("code") or story["response"][3:5]
    return f"The result was {exception_in_words(int(code, 16))}."


def _milliseconds(value: float) -> str:
    return f"{value:.1f} ms" if value < 10 else f"{value:.0f} ms"


def _line_down(story: Story) -> str:
    trouble = f": {story['line_trouble']}" if story.get("line_trouble") else ", and is up now"
    waited, way = _waited(story), _way(story)
    what = f"{waited}and then {way} went down{trouble}" if waited else f"{way[0].upper()}{way[1:]} was down{trouble}"
    return what if what.endswith("?") else f"{what}."


def _stale(story: Story) -> str:
    """Say which source has no fresh value, and who knows why."""
    what, sources = f"{story['reason'] or 'the values are too old'}.", story.get("sources", ())
    others = f" It asks for values of {len(sources)} sources: {', '.join(sources)}." if len(sources) > 1 else ""
    device, line = story.get("stale"), story.get("stale_on")
    if not device or not line:
        return f"No fresh value: {what}{others}"
    commands = f"modbus-gateway trace --why {quote(device)} tells what became of its polls"
    return f"No fresh value: {what}{others} {commands}, modbus-gateway doctor {quote(line)} what to do."


#: What became of a request that was sent, by its result.
_AFTER_SENDING: Final[Mapping[str, str]] = {
    "timeout": "No response came within {limit}.",
    "ambiguous": "A response came after {elapsed}, but another client was heard, and may have asked for it.",
    "line_lost": "The port was lost after {elapsed}, before a response came; the unit may have acted.",
}

#: Why a request was not sent, by its result, where that needs no more than words of the story.
_NOT_SENT: Final[Mapping[str, str]] = {
    "no_route": "There is no route to unit {unit}: {reason}.",
    "only_heard": "Nothing is sent to unit {unit}: {reason}. A mirror of it answers clients.",
    "resting": "The unit had not answered {count} times in a row, and rests{until}: it is left alone.",
    "overdue": "An earlier request to this unit got no response within its limit. It may still come{until} "
    "(late window) and could be taken for the response to this one.",
    "queue_full": "{count} requests waited for {way} already: its queue was full.",
    "expired": "{waited}for {way}, which is longer than its max_wait.",
    "denied": "The client has no right to this {reason}: [[access]] says who may do what.",
    "unwanted": "Its client had left, or sends no more.",
}

#: Results for which that is said of a line or a server.
_OF_LINES: Final = ("line_down", "resting", "queue_full", "expired", "timeout", "line_lost")
