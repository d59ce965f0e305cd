"""What is wrong now: lines that are down or full, the broker, a rejected config, and units that rest or fail."""

from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal

from gateway.lines.counts import UNSENT
from gateway.operator.operations.answers.status import LineStatus, Status, UpstreamStatus
from gateway.operator.operations.answers.trouble import FULL, Trouble
from gateway.operator.status.unit_states import ShownState

#: What is wrong if the last config was not accepted.
REJECTED: Final = "the config was rejected when it was last read: the gateway goes on with the one before"


def troubles(status: Status, states: Mapping[str, ShownState], *, is_rejected: bool = False) -> Iterator[Trouble]:
    """Yield what is wrong now, lines and the broker first. `is_rejected`: the last config was not accepted."""
    for each in status.all_lines:
        if each.state == "down":
            yield Trouble("down", "lines", each.name, reason=each.reason)
    for broker in status.brokers:
        if broker.state == "down":
            yield Trouble("down", "", f"broker {broker.broker}", reason=broker.reason)
    if is_rejected:
        yield Trouble("fix", "", "config", reason=REJECTED)
    busy: tuple[LineStatus | UpstreamStatus, ...] = (*status.lines, *status.upstreams)
    for line in busy:
        share = line.busy_share or 0.0
        if share >= FULL:
            yield Trouble("full", "lines", line.name, share=share)
    yield from _of_units(status, states)


def _of_units(status: Status, states: Mapping[str, ShownState]) -> Iterator[Trouble]:
    down = {each.name for each in status.all_lines if each.state in ("down", "standby")}
    for kind in ("resting", "failing"):
        for unit in status.units:
            state = states[unit.name]
            if state.word == kind and unit.line not in down:
                yield _of_unit(unit, kind, state)
    for image in status.images:
        if image.state == "resting":
            yield Trouble("resting", "units", image.name, reason="timeout", rests_ms=image.rests_ms)


def _of_unit(unit: Any, kind: Literal["resting", "failing"], state: ShownState) -> Trouble:
    return Trouble(
        kind,
        "units",
        unit.name,
        unit.line,
        unit.last_error,
        state.use.unanswered_share,
        state.use.requests,
        unit.rests_ms,
        state.use.unsent,
        max(UNSENT, key=lambda result: getattr(unit.counts, result)) if state.use.unsent else "",
    )
