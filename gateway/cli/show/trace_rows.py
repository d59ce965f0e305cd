"""Facts of the gateway's ring as rows: one for each frame, and one for each request that got no answer."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from gateway.cli.kit.paint import dim, red, yellow
from gateway.operator.trace.stories import clock
from gateway.trace.pdus import exception_in_words, frame_in_words, request_in_words, response_in_words

Fact = Mapping[str, Any]

#: So many sources of a virtual unit are named in a row, if there are many.
_SOURCES_NAMED: Final = 2


class TraceRow(NamedTuple):
    """`way`: `>` to the line, `<` from it, `x` for a request that was not sent, `-` for silence, `!` for a port."""

    time: float
    line: str
    way: str
    unit: str
    text: str

    def show(self, widths: tuple[int, int]) -> str:
        """Show the row, with so much room for line and unit."""
        line, unit = widths
        return f"{dim(clock(self.time))}  {self.line:{line}}  {self.way} {self.unit:>{unit}}  {self._paint(self.text)}"

    @property
    def _paint(self) -> Callable[[str], str]:
        """What was not answered is red, as a lost port is; exceptions, and what nobody asked for, are yellow."""
        if self.way in "x-" or self.text.startswith("port lost"):
            return red
        return yellow if self.unit == "?" or self.text.startswith("exception") else str


def rows(fact: Fact) -> Iterator[TraceRow]:
    """Make the rows of one fact; none of a kind that this version does not know."""
    kind = fact.get("kind")
    if kind == "exchange":
        yield from _exchange(fact)
    elif kind == "refused":
        asked, code = request_in_words(bytes.fromhex(fact["request"])), int(fact["code"], 16)
        why = f": {fact['reason']}" if fact["reason"] else ""
        text = (
            f"{asked} from {fact['client']}{_device(fact)} not sent ({fact['result']}{why}): {exception_in_words(code)}"
        )
        yield TraceRow(fact["time"], fact["line"] or fact["name"] or "-", "x", str(fact["unit"]), text)
    elif kind == "answered":
        yield from _answered(fact)
    elif kind == "heard":
        yield _heard(fact)
    elif kind == "port":
        text = f"port lost: {fact['reason']}" if fact["reason"] else "port open"
        yield TraceRow(fact["time"], fact["line"], "!", "", text)


def _exchange(fact: Fact) -> Iterator[TraceRow]:
    line, address, request = fact["line"], str(fact["address"]), bytes.fromhex(fact["request"])
    clients = ", ".join([fact["client"], *(other["client"] for other in fact.get("others", ()))])
    waited = f", waited {fact['wait_ms']:.0f} ms" if fact["wait_ms"] >= 1 else ""
    again = ", sent again" if fact.get("retries") else ""
    asked = f"{request_in_words(request)}  [{clients} as {fact['unit']}{_device(fact)}{waited}{again}]"
    yield TraceRow(fact["sent"], line, ">", address, asked)
    took = f"{fact['elapsed_ms']:.1f} of {fact['limit_ms']:.0f} ms"
    if fact["response"] is not None:
        text = _with_points(response_in_words(request, bytes.fromhex(fact["response"])), fact)
        unit = fact.get("answered_by")
        yield TraceRow(fact["time"], line, "<", address if unit is None else str(unit), f"{text}  [{took}]")
        return
    if fact.get("heard"):
        yield TraceRow(fact["time"], line, "<", "?", f"no valid response: {fact['heard']}")
    if fact.get("sent_again"):
        yield TraceRow(fact["time"], line, "-", address, f"no response  [{took}]; sent again")
    elif "code" in fact:
        code = exception_in_words(int(fact["code"], 16))
        yield TraceRow(fact["time"], line, "-", address, f"{fact['result']}  [{took}]; {clients}: {code}")


def _answered(fact: Fact) -> Iterator[TraceRow]:
    """Show what the gateway answers itself: from an image, or on a line where it is the server."""
    request, unit = bytes.fromhex(fact["request"]), str(fact["unit"])
    where, came, went = (fact["line"], "<", ">") if fact["line"] else (fact["name"], ">", "<")
    who = "" if fact["line"] else f"  [{fact['client']}]"
    yield TraceRow(fact["received"], where, came, unit, f"{request_in_words(request)}{who}")
    if fact["response"] is not None:
        told = _with_points(response_in_words(request, bytes.fromhex(fact["response"])), fact)
        yield TraceRow(fact["time"], where, went, unit, f"{told}{_sources(fact)}")
    else:
        yield TraceRow(fact["time"], where, "-", unit, f"not answered: {fact['reason']}")


def _with_points(text: str, fact: Fact) -> str:
    """Say what the first points of a transaction are, beside its numbers: `17820 18538  (weight 4999.66 kg)`."""
    points = [f"{each['point']} {each['text']}" for each in fact.get("points", ())]
    more = [f"{fact['more_points']} more"] if fact.get("more_points") else []
    return f"{text}  ({', '.join(points + more)})" if points else text


def _device(fact: Fact) -> str:
    """Say to which device a request went through a mirror or virtual unit."""
    return f" to {fact['device']}" if fact.get("device") else ""


def _sources(fact: Fact) -> str:
    """Say of which devices the values are: `  [from meter-1, meter-2, ... 20 sources]`."""
    sources = fact.get("sources", ())
    named = ", ".join(sources[:_SOURCES_NAMED])
    if len(sources) > _SOURCES_NAMED + 1:
        return f"  [from {named}, ... {len(sources)} sources]"
    return f"  [from {', '.join(sources)}]" if sources else ""


def _heard(fact: Fact) -> TraceRow:
    data, owner = bytes.fromhex(fact["frame"]), fact["owner"]
    if owner == "noise":
        more = " ..." if fact["count"] > len(data) else ""
        return TraceRow(fact["time"], fact["line"], "<", "?", f"{fact['count']} bytes of noise: {fact['frame']}{more}")
    is_request = owner in ("another's request", "an echo")
    text = frame_in_words(data[1:], is_request=is_request)
    return TraceRow(fact["time"], fact["line"], "<", str(data[0]), f"{text}  [{_OWNERS.get(owner, owner)}]")


_OWNERS: Mapping[str, str] = {
    "another client": "response to another client",
    "a late response": "late response",
    "an echo": "echo",
    "another's request": "request of another client",
    "nobody": "not requested by anybody",
}
