"""Rates of the last minute, from samples of the counters."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final, Literal, NamedTuple

from gateway.diagnosis.last import NOW, Last
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.timing.usage import Use, User

#: The time between two samples in seconds, and how many are kept: those of a minute.
STEP: Final = 5.0
_KEPT: Final = 13
#: A line whose use, and whose characters, are watched.
OnPort = GatewayLine | GatewayMonitor
#: What a driver finds wrong with a character.
Wrong = Literal["parity", "framing"]
WRONG: Final[tuple[Wrong, ...]] = ("parity", "framing")
#: How often the lag of the event loop is measured within a step.
_LOOKS: Final = 5


class Rate(NamedTuple):
    """The share of time in which a line or upstream was busy, and requests sent per second."""

    busy: float
    per_second: float


class LineUser(NamedTuple):
    """A user of a line: its share of the line's time, and its transactions per second."""

    user: User
    share: float
    per_second: float


class _Sample(NamedTuple):
    at: float
    lag: float
    busy: Mapping[Owner, float]
    sent: Mapping[Owner, int]
    #: Use of the lines since the previous sample.
    used: Mapping[Owner, Mapping[User, Use]]


class _Wrong(NamedTuple):
    """How many characters of a line were wrong, when this number last rose, and how many requests were sent by then."""

    characters: int
    at: float
    sent: int


class Recent:
    """Samples of the last minute. A reload may have replaced some lines."""

    def __init__(self, gateway: Gateway, now: float) -> None:
        self._wrong: dict[tuple[OnPort, Wrong], _Wrong] = {}
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
            self._look_at_characters(gateway(), loop.time())

    def rate(self, owner: Owner, now: float) -> Rate | None:
        """Compute the rates of a line or upstream; None if it is too new."""
        first = next((each for each in self._samples if owner in each.busy), None)
        if first is None or now - first.at < 1.0:
            return None
        busy, sent = owner.busy(now) - first.busy[owner], owner.sent - first.sent[owner]
        return Rate(min(busy / (now - first.at), 1.0), sent / (now - first.at))

    def last_wrong(self, line: OnPort, kind: Wrong, now: float) -> Last:
        """Return when a character was last wrong in this way, to the next sample."""
        seen, errors = self._wrong.get((line, kind)), line.driver.errors
        if seen is None or errors is None or getattr(errors, kind) > seen.characters:
            return NOW
        return Last(now - seen.at, line.sent - seen.sent)

    def _look_at_characters(self, gateway: Gateway, now: float) -> None:
        before, self._wrong = self._wrong, {}
        for line in _on_ports(gateway):
            errors = line.driver.errors
            for kind in WRONG if errors is not None else ():
                wrong, seen = getattr(errors, kind), before.get((line, kind))
                if seen is None or wrong > seen.characters:
                    self._wrong[line, kind] = _Wrong(wrong, now, line.sent)
                else:  # fewer, if the port was opened again
                    self._wrong[line, kind] = seen._replace(characters=wrong)

    def users(self, line: OnPort, now: float) -> list[LineUser]:
        """List the users of `line`, most time first; a shared request counts for the client that asked first."""
        first = next((at for at, each in enumerate(self._samples) if line in each.busy), None)
        if first is None or now <= self._samples[first].at:
            return []
        elapsed = now - self._samples[first].at
        uses: dict[User, Use] = {}
        behind = list(self._samples)[first + 1 :]
        for rows in (*(each.used.get(line, {}) for each in behind), line.usage.look()):
            for user, use in rows.items():
                uses.setdefault(user, Use()).add(use.seconds, use.transactions)
        users = [LineUser(user, use.seconds / elapsed, use.transactions / elapsed) for user, use in uses.items()]
        return sorted(users, key=lambda each: -each.share)

    def was_asked(self, line: GatewayLine) -> bool:
        """Return whether its units were asked anything in the last minute, or since a newer line exists."""
        first = next((each.sent[line] for each in self._samples if line in each.sent), 0)
        return len(line.driver.line.queue) > 0 or line.driver.line.is_busy or line.sent > first

    @property
    def loop_lag(self) -> float:
        """The largest delay of the event loop in the last minute, in seconds."""
        return max(each.lag for each in self._samples)


def _on_ports(gateway: Gateway) -> tuple[OnPort, ...]:
    return (*gateway.lines, *gateway.monitors)


def _sample(gateway: Gateway, now: float, lag: float) -> _Sample:
    return _Sample(
        now,
        lag,
        {owner: owner.busy(now) for owner in gateway.owners},
        {owner: owner.sent for owner in gateway.owners},
        {line: line.usage.take() for line in _on_ports(gateway)},
    )
