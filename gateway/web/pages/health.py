"""The page of the health: the findings of doctor."""

import re
from collections.abc import Sequence
from typing import Final

from aiohttp import web

from gateway.diagnosis.finding import Finding
from gateway.tools.examinations import Report
from gateway.web.access.guard import VISITOR
from gateway.web.pages.page import Page, route
from gateway.web.pages.times import day_and_time

#: What a user types literally: commands, and keys of the config with their values.
_TYPED: Final = re.compile(
    r"((?:systemctl|modbus-gateway|echo|kill) [^,;]*?(?= shows |[,;]|$)"
    r'|\b[a-z_]+ = (?:"[^"]*"|[^\s,;]+)|\[+[a-z]+\]+|--\w+)'
)


class HealthPage(Page):
    """The handlers of `/health`."""

    @route("GET", "/health")
    async def show(self, request: web.Request) -> web.Response:
        """Show what was measured, and what devices answered when they were last asked."""
        return await self._page(request)

    @route("POST", "/health", "operator")
    async def examine(self, request: web.Request) -> web.Response:
        """Start an examination that asks devices too."""
        why_not = self._doctor.start(request[VISITOR].user)
        if not why_not:
            raise web.HTTPSeeOther("/health")
        response = await self._page(request, why_not)
        response.set_status(409)
        return response

    async def _page(self, request: web.Request, why_not: str = "") -> web.Response:
        doctor = self._doctor
        return await self._renderer.page(
            "health.html",
            request,
            measured=await doctor.measured(),
            last=doctor.last,
            is_running=doctor.is_running,
            why_not=why_not,
            counted=counted,
            ranked=ranked,
            clock=day_and_time,
            in_parts=in_parts,
        )


def counted(report: Report) -> dict[str, int]:
    """Count the findings of each level, the worst level first."""
    levels = [finding.level for _, findings in report.groups for finding in findings]
    return {level: levels.count(level) for level in ("fix", "note", "ok")}


def ranked(report: Report) -> list[tuple[str, Sequence[Finding]]]:
    """Sort the findings of each line, and the lines, by what must be fixed first."""
    groups = [(name, sorted(found, key=_rank)) for name, found in report.groups if found]
    return sorted(groups, key=lambda group: _rank(group[1][0]))


def in_parts(remedy: str) -> list[tuple[str, bool]]:
    """Split a remedy into parts, each with whether it is to be typed literally."""
    return [(text, place % 2 == 1) for place, text in enumerate(_TYPED.split(remedy)) if text]


def _rank(finding: Finding) -> int:
    return ("fix", "note", "ok").index(finding.level)
