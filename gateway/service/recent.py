"""Rates of the last minute, from samples of the counters."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gateway.service.build import Gateway
from gateway.service.parts import GatewayLine
from gateway.timing.usage import Use, User

#: The time between two samples in seconds, and how many are kept: those of a minute.
STEP: Final = 5.0
_KEPT: Final = 13
#: How often the lag of the event loop is measured within a step.
_LOOKS: Final = 5


class Rate(NamedTuple):
    """The share of time in which a line was busy, and requests sent per second."""

    busy: float
    per_second: float


class LineUser(NamedTuple):
    """Somebody's share of a line's time, and how many transactions in a second were his."""

    user: User
    share: float
    per_second: float


class _Sample(NamedTuple):
    at: float
    lag: float
    busy: Mapping[GatewayLine, float]
    sent: Mapping[GatewayLine, int]
    #: Who used the lines since the sample before.
    used: Mapping[GatewayLine, Mapping[User, Use]]


class Recent:
    """Samples of the last minute. A reload may have replaced some lines."""

    def __init__(self, gateway: Gateway, now: float) -> None:
        self._samples: deque[_Sample] = deque([_sample(gateway, now, 0.0)], maxlen=_KEPT)

    async def keep_sampling(self, gateway: Callable[[], Gateway]) -> None:
        """Take samples until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            lag = 0.0
            for _ in range(_LOOKS):
                due = loop.time() + STEP / _LOOKS
                await asyncio.sleep(STEP / _LOOKS)
                lag = max(lag, loop.time() - due)
            self._samples.append(_sample(gateway(), loop.time(), lag))

    def rate(self, line: GatewayLine, now: float) -> Rate | None:
        """The rates of `line`; None if it is too new."""
        first = next((each for each in self._samples if line in each.busy), None)
        if first is None or now - first.at < 1.0:
            return None
        busy, sent = _busy(line, now) - first.busy[line], line.sent - first.sent[line]
        return Rate(min(busy / (now - first.at), 1.0), sent / (now - first.at))

    def users(self, line: GatewayLine, now: float) -> list[LineUser]:
        """Who used `line`, the most time first; a shared request counts for the client that asked first."""
        first = next((at for at, each in enumerate(self._samples) if line in each.busy), None)
        if first is None or now <= self._samples[first].at:
            return []
        elapsed = now - self._samples[first].at
        uses: dict[User, Use] = {}
        behind = list(self._samples)[first + 1 :]
        for rows in (*(each.used.get(line, {}) for each in behind), line.driver.line.spent.usage.look()):
            for user, use in rows.items():
                uses.setdefault(user, Use()).add(use.seconds, use.transactions)
        users = [LineUser(user, use.seconds / elapsed, use.transactions / elapsed) for user, use in uses.items()]
        return sorted(users, key=lambda each: -each.share)

    def was_asked(self, line: GatewayLine) -> bool:
        """Whether anything was asked of its units in the last minute; since it is there, if it is new."""
        first = next((each.sent[line] for each in self._samples if line in each.sent), 0)
        return line.driver.line.waiting > 0 or line.driver.line.is_busy or line.sent > first

    @property
    def loop_lag(self) -> float:
        """The largest delay of the event loop, in seconds."""
        return max(each.lag for each in self._samples)


def _sample(gateway: Gateway, now: float, lag: float) -> _Sample:
    lines = gateway.lines
    return _Sample(
        now,
        lag,
        {line: _busy(line, now) for line in lines},
        {line: line.sent for line in lines},
        {line: line.driver.line.spent.usage.take() for line in lines},
    )


def _busy(line: GatewayLine, now: float) -> float:
    return line.driver.line.phases(now).busy
