"""The sites of a fleet, as `status --fleet` shows them: those with trouble, and how many there are of what."""

from collections.abc import Sequence
from datetime import date
from math import inf
from typing import Final

from gateway.cli.kit.columns import Table
from gateway.cli.kit.paint import red, yellow
from gateway.cli.show.status_tables import painted
from gateway.config.problem import listed
from gateway.config.values.duration import show_age
from gateway.fleet.status import SiteStatus
from gateway.operator.fleet.sites import days_left, is_fine, summary_of, to_fix
from gateway.operator.operations.answers.status import Sites
from gateway.tls.status import EARLY

#: Of more sites than this, only those are listed that are not fine.
MOST: Final = 50
#: So many configs, or versions, are counted.
_MOST_KINDS: Final = 4


def sites_as_text(told: Sites, day: date, width: int, *, shows_all: bool) -> str:
    """Show the sites of a fleet, those that are not fine first; below them how many there are of what."""
    sites = told.sites
    if len(sites) > MOST and not shows_all:
        sites = tuple(each for each in sites if not is_fine(each, day))
    table = _table(day).show(Sites(sites), width)
    fine = len(told.sites) - len(sites)
    rest = f"{fine} sites are fine; --all lists them, too" if fine else ""
    if fine == 1:
        rest = "1 site is fine; --all lists it, too"
    return "\n".join([*filter(None, (table, rest and f"  {rest}")), "", *_summary(told, day)])


def _table(day: date) -> Table[Sites, SiteStatus]:
    return Table(
        "Sites",
        lambda sites: sites.sites,
        {
            "SITE": lambda site: site.site,
            "STATE": lambda site: painted(site.state),
            "FOR": lambda site: show_age(1000 * site.for_s),
            "LINES UP": lambda site: site.lines,
            "DOWN": lambda site: red(listed(site.lines_down)) or "-",
            "UNITS": lambda site: site.units,
            "TO FIX": lambda site: yellow(str(to_fix(site) or "")) or "-",
            "EXPIRES": lambda site: _in_days(days_left(site, day)),
            "CONFIG": lambda site: (site.inventory and site.inventory.config) or "-",
            "VERSION": lambda site: site.version,
            "HOST": lambda site: site.host,
        },
    )


def _in_days(left: float) -> str:
    if left == inf:
        return "-"
    text = f"{left:.0f} d"
    return red(text) if left < 0 else yellow(text) if left < EARLY else text


def _summary(told: Sites, day: date) -> list[str]:
    summary = summary_of(told.sites, day)
    states = ", ".join(f"{count} {state}" for state, count in summary.states)
    wrong = [
        f"{count} with {what}"
        for count, what in (
            (summary.lines_down, "lines down"),
            (summary.to_fix, "something to fix (modbus-gateway doctor there)"),
            (summary.expiring, f"a certificate that expires within {EARLY:.0f} days"),
        )
        if count
    ]
    return [
        f"{summary.sites} {'site' if summary.sites == 1 else 'sites'}: {'; '.join([states, *wrong])}",
        *_kinds("config", summary.configs),
        *_kinds("version", summary.versions),
    ]


def _kinds(kind: str, counted: Sequence[tuple[str, int]]) -> list[str]:
    """Count configs or versions, if there are several."""
    if len(counted) < 2:
        return []
    shown = [f"{name} at {count}" for name, count in counted[:_MOST_KINDS]]
    others = counted[_MOST_KINDS:]
    if others:
        shown.append(f"{len(others)} more at {sum(count for _, count in others)}")
    return [f"{len(counted)} {kind}s: {', '.join(shown)}"]
