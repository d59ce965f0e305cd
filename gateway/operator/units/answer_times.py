"""Response times of a device, beside their limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

from gateway.clock.times import milliseconds, optional_ms
from gateway.lines.counts import Counts
from gateway.operator.operations.answers.unit import UnitHead
from gateway.operator.units.calibration import measured
from gateway.operator.units.reached import device_of
from gateway.runtime.gateway import Gateway
from gateway.timing.budget import NETWORK_LATENCY
from gateway.timing.histogram import SECONDS
from gateway.timing.measured import Times
from gateway.timing.proposal import MeasuredTimes, Proposal
from gateway.timing.verdict import CLOSE, ENOUGH_TO_SHORTEN, Verdict, verdict


@dataclass(frozen=True, slots=True)
class FunctionTimes:
    """Response times of one function of a device, and whether the limit suits them.

    `counts` are the responses in the buckets below `bounds_ms`, and in one more for all longer times. `share_p99` is
    the part of its limit that 99 of 100 responses needed at most. `late` responses came after the limit; the slowest
    took `latest_ms`, when the limit was `latest_limit_ms`. `limit_ms` is the present limit, None before the first
    request. `proposed_ms` is the limit that `calibrate` proposes, raised if exceptions or late responses took longer;
    None without enough responses, or where no timing table applies.
    """

    function: int
    responses: int
    timeouts: int
    late: int
    latest_ms: float
    latest_limit_ms: float
    bounds_ms: tuple[float, ...]
    counts: tuple[int, ...]
    p50_ms: float | None
    p99_ms: float | None
    share_p99: float | None
    limit_ms: float | None
    proposed_ms: float | None
    verdict: Verdict


def answer_times(gateway: Gateway, unit: UnitHead) -> tuple[FunctionTimes, ...]:
    """List the times of a device by function that was sent to it; empty if the unit is not a device."""
    device = device_of(gateway, unit.key)
    if device is None:
        return ()
    proposed = _proposed(gateway, unit.name)
    found = sorted((function, times) for function, times in device.counts.times.items() if times.limit)
    return tuple(_times(function, times, device.counts[function], proposed.get(function)) for function, times in found)


def _times(function: int, times: Times, counts: Counts, proposed_ms: float | None) -> FunctionTimes:
    share, limit_ms, p99_ms = times.share.quantile(0.99), times.limit * 1000, optional_ms(times.answer.quantile(0.99))
    if proposed_ms is not None:  # exceptions and late responses are not in the samples
        proposed_ms = max(proposed_ms, p99_ms or 0.0, milliseconds(times.latest / CLOSE))
    return FunctionTimes(
        function=function,
        responses=counts.responses,
        timeouts=counts.timeout,
        late=times.late,
        latest_ms=milliseconds(times.latest),
        latest_limit_ms=milliseconds(times.latest_limit),
        bounds_ms=tuple(bound * 1000 for bound in SECONDS.bounds),
        counts=tuple(times.answer.counts),
        p50_ms=optional_ms(times.answer.quantile(0.5)),
        p99_ms=p99_ms,
        share_p99=share,
        limit_ms=milliseconds(times.limit) or None,
        proposed_ms=proposed_ms,
        verdict=verdict(share, counts.responses, times.late, limit_ms, proposed_ms),
    )


def _proposed(gateway: Gateway, unit: str) -> Mapping[int, float]:
    """Compute the longest limit that `calibrate` would propose for each function with enough responses, in ms."""
    about = measured(gateway, unit)
    rows = [
        MeasuredTimes(
            each.function,
            each.items,
            tuple(time / 1000 for time in each.times_ms),
            each.allowed_ms + 1000 * NETWORK_LATENCY if about.mode == "tcp" else each.limit_ms,
            each.allowed_ms,
            each.longest_ms / 1000,
            each.count,
        )
        for each in about.rows
    ]
    proposal = Proposal(rows, about.margin)
    of_function = {function: list(each) for function, each in groupby(rows, lambda row: row.function)}
    return {
        function: milliseconds(max(map(proposal.limit, each)))
        for function, each in of_function.items()
        if sum(row.count for row in each) >= ENOUGH_TO_SHORTEN
    }
