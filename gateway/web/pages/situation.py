"""How the gateway is doing, as the head of every page and the overview say it: looked at once a second at most."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from gateway.operator.answers.status import Status
from gateway.operator.operator import Operator
from gateway.operator.past import past_of
from gateway.operator.status import recent_status
from gateway.timing.history import UNIT_SLOTS, Past
from gateway.tools.examinations import Examinations, Report
from gateway.web.pages.troubles import Trouble, troubles, with_findings
from gateway.web.pages.unit_states import ShownState, states_of


@dataclass(frozen=True)
class Situation:
    """The status, the history of the last day, and the findings of doctor. The gateway has run for `up_s` seconds.

    What follows from them is computed when it is asked for, in the thread that makes a page.
    """

    status: Status
    past: Past
    report: Report
    up_s: float

    @cached_property
    def states(self) -> Mapping[str, ShownState]:
        """The states of the units, by name."""
        return states_of(self.status.units, self.past)

    @cached_property
    def troubles(self) -> Sequence[Trouble]:
        """What is wrong, lines and the broker first."""
        return with_findings(list(troubles(self.status, self.states)), self.report)


class Situations:
    """Looks at a gateway."""

    def __init__(self, operator: Operator, doctor: Examinations) -> None:
        self._operator = operator
        self._doctor = doctor
        self._last: Situation | None = None

    async def now(self) -> Situation:
        """Look at the gateway now, or return what was seen less than a second ago."""
        status, report = await recent_status(self._operator), await self._doctor.measured()
        last = self._last
        if last is None or last.status is not status or last.report is not report:
            up = asyncio.get_running_loop().time() - self._operator.running.started
            last = self._last = Situation(status, past_of(self._operator, UNIT_SLOTS), report, up)
        return last
