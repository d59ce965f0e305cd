"""How the gateway is doing, as the head of every page and the overview say it: looked at once a second at most."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from gateway.diagnosis.finding import Finding
from gateway.operator.operations.answers.status import Status
from gateway.operator.operations.answers.trouble import Trouble
from gateway.operator.operator import Operator
from gateway.operator.past.past import past_of
from gateway.operator.status.status import recent_status
from gateway.operator.status.unit_states import ShownState, lines_down, states_of
from gateway.timing.history import UNIT_SLOTS, Past
from gateway.tools.examinations import Examinations, Report


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
        return states_of(self.status.units, self.past, lines_down(self.status))

    @cached_property
    def troubles(self) -> Sequence[Trouble]:
        """What is wrong, lines and the broker first."""
        return with_findings(self.status.troubles, self.report)


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


def with_findings(known: Sequence[Trouble], report: Report) -> list[Trouble]:
    """Add what doctor says must be fixed to the troubles, and append what is wrong besides."""
    fixes: dict[tuple[str, str], Trouble] = {}
    for line, findings in report.groups:
        for each in findings:
            if each.level == "fix":
                one = _trouble(each, line)
                before = fixes.setdefault((one.page, one.name), one)
                fixes[one.page, one.name] = replace(one, found=(*before.found, each.what))
    told = []
    for trouble in known:
        fix = fixes.pop((trouble.page, trouble.name), None)
        # If it is down, its row says already what doctor would add.
        told.append(trouble if fix is None or trouble.kind == "down" else replace(trouble, found=fix.found))
    return [*told, *fixes.values()]


def _trouble(finding: Finding, line: str) -> Trouble:
    if finding.unit:
        return Trouble("fix", "units", finding.unit, line)
    return Trouble("fix", "lines", line) if line else Trouble("fix", "", finding.about)
