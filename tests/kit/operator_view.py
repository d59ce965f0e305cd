"""What an operator sees of a line: events, counters, the trace, how the line's time was used, which units rest.

| step                             | meaning                                                                      |
|----------------------------------|------------------------------------------------------------------------------|
| `event LateResponse unit 1`      | the next event of this name has these fields; `advice has echo`: as part     |
| `no event LateResponse`          | no further event of this name; `no event`: none at all                       |
| `trace Incident heard 55`        | the next record of this kind in the trace has these fields; times: from now  |
| `counts: timeout 1`              | the sum over all units                                                       |
| `counts unit 1: late 2`          | of one unit, with `instead` (kept bytes), `late` and `latest_ms`             |
| `counts line: waiting 1`         | of the line; `askers`: how often another client was told to whom shares it   |
| `line spent request 4.6, ..`     | its time by phase (`request`, `wait`, `response`, `gap`), in milliseconds    |
| `line used by panel 01 03 9 ms`  | how long a client has taken it with this unit and function                   |
| `unit 1 rests`, `unit 1 awake`   | whether it rests                                                             |
| `unit 1 moving`, `.. settled`    | whether it may still change its address, so that it cannot be forgotten      |
"""

from collections.abc import Callable

from gateway.devices.device import Device
from gateway.errors import RequestError
from gateway.events import Event
from gateway.lines.counts import Counts, total
from gateway.timing.measured import NEVER
from gateway.trace.ring import Ring
from kit.line_bench import Bench


def assert_same(is_so: str | None, expected: str) -> None:
    assert is_so == expected, f"but: {is_so}"


class OperatorView:
    """Looks at `bench`; `ring` has the trace. Events and records are passed once."""

    bench: Bench

    def __init__(self) -> None:
        self.ring = Ring(2**24)
        self._traced = 0
        self._seen: list[Event] = []

    def play(self, who: str, rest: str) -> bool:
        """Play a step, if it is one of those above."""
        match who:
            case "event":
                self._event(rest)
            case "no":
                self._no_event(rest.removeprefix("event").strip())
            case "trace":
                self._trace(rest)
            case "counts" | "counts:":
                self._count(f"{who} {rest}")
            case "unit":
                unit, word = rest.split()
                assert self._unit_is(self.bench.devices[int(unit)], word)
            case _:
                return False
        return True

    def line(self, what: str, text: str) -> None:
        """Look at how the line's time was used."""
        match what:
            case "spent":
                phases = self.bench.line.phases(self.bench.now)
                names = [each.split()[0] for each in text.split(", ")]
                assert_same(", ".join(f"{name} {1000 * getattr(phases, name):.1f}" for name in names), text)
            case "used":
                client, unit, function, milliseconds = text.removesuffix(" ms").removeprefix("by ").split()
                use = self.bench.line.spent.usage.look()[client, int(unit, 16), int(function, 16)]
                assert_same(f"{1000 * use.seconds:.1f}", milliseconds)
            case _:
                raise ValueError(what)

    def _unit_is(self, device: Device, word: str) -> bool:
        now = self.bench.now
        is_moving = self.bench.line.ledger.changes_until(device.possible_units) > now
        is_resting = device.is_resting(now)
        return {"rests": is_resting, "awake": not is_resting, "moving": is_moving, "settled": not is_moving}[word]

    def _event(self, text: str) -> None:
        name, _, fields = text.partition(" ")
        told = next((event for event in self._unseen() if type(event).__name__ == name), None)
        assert told is not None, self.bench.events
        self._seen.append(told)
        for field in fields.split(", ") if fields else ():
            key, _, value = field.partition(" ")
            shown = str(getattr(told, key))
            if value.startswith("has "):
                assert value.removeprefix("has ") in shown, shown
            else:
                assert_same(shown, value)

    def _no_event(self, name: str) -> None:
        assert [event for event in self._unseen() if name in ("", type(event).__name__)] == []

    def _unseen(self) -> list[Event]:
        return [event for event in self.bench.events if not any(event is seen for seen in self._seen)]

    def _trace(self, text: str) -> None:
        name, _, fields = text.partition(" ")
        records = self.ring.after(0)[self._traced :]
        at = next((at for at, record in enumerate(records) if type(record).__name__ == name), None)
        assert at is not None, [type(record).__name__ for record in records]
        self._traced += at + 1
        for field in fields.split(", ") if fields else ():
            key = field.partition(" ")[0]
            assert_same(f"{key} {self._traced_as(getattr(records[at], key))}", field)

    def _traced_as(self, value: object) -> str:
        match value:
            case bytes():
                return value.hex(" ").upper() or "nothing"
            case RequestError():
                return value.result
            case float():
                return f"{1000 * (value - self.bench.now):.1f} ms" if value else "never"
        return str(value)

    def _count(self, step: str) -> None:
        whose, _, text = step.partition(": ")
        numbers = [each.split() for each in text.split(", ")]
        counts = self._counts(whose.removeprefix("counts").removesuffix(":").strip())
        assert_same(", ".join(f"{name} {counts(name)}" for name, _ in numbers), text)

    def _counts(self, whose: str) -> Callable[[str], int]:
        if whose == "line":
            return self._counts_of_line().__getitem__
        if whose:
            return self._counts_of_unit(int(whose.removeprefix("unit ")))
        counts: Counts = self.bench.counts
        return lambda name: getattr(counts, name)

    def _counts_of_unit(self, unit: int) -> Callable[[str], int]:
        of_unit = self.bench.devices[unit].counts
        counts, times = total(of_unit.values()), of_unit.times.values()
        kept = {
            "instead": len(of_unit.received_instead),
            "late": sum(each.late for each in times),
            "latest_ms": round(1000 * max((each.latest for each in times), default=0.0)),
        }
        return lambda name: kept[name] if name in kept else getattr(counts, name)

    def _counts_of_line(self) -> dict[str, int]:
        line, now = self.bench.line, self.bench.now
        others, belated = line.attribution.overheard, line.attribution.overheard.belated.values()
        return {
            "waiting": len(line.queue),
            "late_windows": line.ledger.count_late(now),
            "unasked_bytes": line.unasked_bytes,
            "askers": self.bench.askers,
            "copies": others.copies,
            "copies_in_a_row": line.attribution.echoes_in_a_row,
            "sent_since_copy": others.sent_since_copy,
            "copied_ms_ago": _ms_ago(others.copied_at, now),
            "requests": others.requests,
            "sent_since_request": others.sent_since_request,
            "requested_ms_ago": _ms_ago(others.requested_at, now),
            "second_responses": sum(others.second_responses.values()),
            "belated": sum(each.count for each in belated),
            "belated_ms": round(1000 * max((each.longest for each in belated), default=0.0)),
            "belated_limit_ms": round(1000 * max((each.limit for each in belated), default=0.0)),
        }


def _ms_ago(then: float, now: float) -> int:
    return -1 if then == NEVER else round(1000 * (now - then))
