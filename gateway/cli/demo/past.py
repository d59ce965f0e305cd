"""A day that never was: the history of the demo's lines and units before it began, so that its pages have something.

It is MADE UP. It is only ever given to the demo's own gateway, which keeps no file of it.
"""

import time
from collections.abc import Iterator, Sequence
from math import exp
from random import Random
from typing import Final, NamedTuple

from gateway import events
from gateway.cli.demo.live import USER
from gateway.config.plan.settings import Plan
from gateway.observe.last_events import LastEvent, LastEvents
from gateway.timing.history import STEP, UNIT_SLOTS, LineUse, Slot, UnitUse, slot_at

#: How busy each line is in working hours, and how many requests a second each of its units gets.
_BUSY: Final = {"silo": 0.28, "dock": 0.24, "yard": 0.26, "plc": 0.31, "motion": 0.42, "hall": 0.74, "meters": 0.38}
_RATE: Final = 1.6
#: The units that are switched off.
_OFF: Final = ("axis-2", "spare")
#: How long an answer takes in seconds, and its share of the time limit.
_ANSWER: Final = 0.031
_SHARE: Final = 0.22
_HOUR: Final = 3600 // STEP
#: A unit that loses more than this share of its requests rests, some seconds after that began.
_RESTS_FROM: Final = 0.5
_LATER: Final = 40.0
_REST: Final = 10.0
_LOGIN_AGO: Final = 11 * 3600.0


class _Trouble(NamedTuple):
    """So many slots before the end this `share` of a unit's requests begins to be lost, for so many slots."""

    unit: str
    ago: int
    slots: int
    share: float

    @property
    def begun(self) -> float:
        """How many seconds ago it began."""
        return float(self.ago * STEP)

    @property
    def ended(self) -> float:
        """How many seconds ago it ended."""
        return float((self.ago - self.slots) * STEP)

    def is_at(self, ago: int) -> bool:
        """Tell whether it was in the slot that many slots ago."""
        return self.ago - self.slots < ago <= self.ago


TROUBLES: Final = (
    _Trouble("drive-72", 9 * _HOUR, 8, 0.35),
    _Trouble("oven", 20 * _HOUR, 3, 0.9),
    _Trouble("meter-lab", 3 * _HOUR, 2, 0.15),
)
#: The adapter of this line was unplugged for an hour, and for so long the gateway did not run.
UNPLUGGED: Final = _Trouble("yard", 6 * _HOUR, _HOUR, 1.0)
STOPPED: Final = _Trouble("", 14 * _HOUR, 2, 1.0)


def made_up_day(plan: Plan, now: float) -> list[Slot]:
    """Make the slots of the day before `now`, in seconds since 1970, with the names of this plan."""
    dice = Random("demo")  # noqa: S311 - not a secret, and repeatable
    last = slot_at(now)
    return [_slot(plan, last - ago, ago, dice) for ago in range(UNIT_SLOTS - 1, 0, -1) if not STOPPED.is_at(ago)]


def activity(at: float) -> float:
    """Compute how much goes on in a plant at a time, in seconds since 1970: from 0 at night to 1 at the best hours."""
    local = time.localtime(at)
    hour = local.tm_hour + local.tm_min / 60
    lunch = 0.35 * exp(-((hour - 12.3) ** 2) / 0.4)
    return 1 / (1 + exp(-2 * (hour - 6))) - 1 / (1 + exp(-1.2 * (hour - 19))) - lunch


def _slot(plan: Plan, number: int, ago: int, dice: Random) -> Slot:
    slot, level = Slot(number), 0.35 + 0.65 * activity(number * STEP)
    for line in plan.lines:
        name = line.line.name
        is_down = name == UNPLUGGED.unit and UNPLUGGED.is_at(ago)
        units = dict(_units([device.name for device in line.devices], level, ago, dice, is_down=is_down))
        share = _BUSY.get(name, 0.2) * level * dice.uniform(0.93, 1.07)
        use = LineUse(
            seconds=STEP,
            busy=0.0 if is_down else STEP * share,
            down=float(STEP) if is_down else 0.0,
            sent=sum(unit.requests - unit.unsent for unit in units.values()),
            failed=sum(unit.lost for unit in units.values()),
        )
        slot.add({name: use}, units)
    return slot


def _units(
    names: Sequence[str], level: float, ago: int, dice: Random, *, is_down: bool
) -> Iterator[tuple[str, UnitUse]]:
    for name in names:
        requests = round(STEP * _RATE * level * dice.uniform(0.95, 1.05) / len(names))
        if is_down:
            yield name, UnitUse(requests=requests, unsent=requests)
        elif name in _OFF:
            yield name, UnitUse(requests=requests, timeouts=9, unsent=requests - 9, resting=STEP * 0.93)
        else:
            yield name, _use(requests, next((each.share for each in TROUBLES if _is_of(each, name, ago)), 0.0), dice)


def _is_of(trouble: _Trouble, name: str, ago: int) -> bool:
    return trouble.unit == name and trouble.is_at(ago)


def _use(requests: int, lost_share: float, dice: Random) -> UnitUse:
    lost = round(requests * lost_share)
    responses = requests - lost
    return UnitUse(
        requests=requests,
        timeouts=lost,
        exceptions=responses // 400,
        responses=responses,
        answer=responses * _ANSWER * dice.uniform(0.9, 1.1),
        share=responses * _SHARE * dice.uniform(0.9, 1.1),
    )


def made_up_events(plan: Plan, now: float) -> Sequence[LastEvent]:
    """Make the events of the day before `now`, in seconds since 1970, with the names of this plan."""
    time = now
    past = LastEvents(lambda: time)
    for ago, event in sorted(_events(plan), key=lambda told: -told[0]):
        time = now - ago
        past.add(event)
    return past.all()


def _events(plan: Plan) -> Sequence[tuple[float, events.Event]]:
    """List events, each with how many seconds ago it was."""
    line = next(line for line in plan.lines if line.name == UNPLUGGED.unit)
    port, baud, lines = line.port.port, line.line.timing.baud, len(plan.lines)
    told: list[tuple[float, events.Event]] = [
        (STOPPED.begun, events.Stopping("SIGTERM")),
        (STOPPED.ended, events.Ready((), lines, 0)),
        (UNPLUGGED.begun, events.LineLost(line.name, port, "the adapter was unplugged")),
        (UNPLUGGED.ended, events.LineReopened(line.name, port, UNPLUGGED.begun - UNPLUGGED.ended, baud)),
        (_LOGIN_AGO, events.WebLogin("web@127.0.0.1", USER)),
    ]
    for owner, device in ((line, device) for line in plan.lines for device in line.devices):
        for trouble in TROUBLES:
            if trouble.unit == device.name and trouble.share > _RESTS_FROM:
                resting = events.UnitResting(owner.name, device.unit, device.name, _REST, device.source)
                told.append((trouble.begun - _LATER, resting))
                told.append((trouble.ended, events.UnitRecovered(owner.name, device.unit, device.name)))
    return told
