"""What would have happened on the day that `past` makes up, as events of an earlier run. It is MADE UP, too."""

from collections.abc import Sequence
from typing import Final

from gateway import events
from gateway.cli.demo.live import USER
from gateway.cli.demo.past import STOPPED, TROUBLES, UNPLUGGED
from gateway.config.plan.settings import Plan
from gateway.observe.last_events import LastEvent, LastEvents

#: A unit that loses more than this share of its requests rests, some seconds after that began.
_RESTS_FROM: Final = 0.5
_LATER: Final = 40.0
_REST: Final = 10.0
_LOGIN_AGO: Final = 11 * 3600.0


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
