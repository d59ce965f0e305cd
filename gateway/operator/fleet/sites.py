"""The sites of a fleet as an operator looks at them: which are not fine, and how many have what in common."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from math import inf

from gateway.fleet.status import SiteStatus
from gateway.tls.status import EARLY


@dataclass(frozen=True, slots=True)
class FleetSummary:
    """How many sites there are, in each state, with lines down, with something to fix, and with certificates to renew.

    `configs` and `versions` are those that sites have, with the numbers of sites, the most common ones first.
    """

    sites: int
    states: Sequence[tuple[str, int]]
    lines_down: int
    to_fix: int
    expiring: int
    configs: Sequence[tuple[str, int]]
    versions: Sequence[tuple[str, int]]


def today(at: float) -> date:
    """Return the day of a time in seconds since 1970, in UTC as the dates of certificates."""
    return datetime.fromtimestamp(at, UTC).date()


def days_left(site: SiteStatus, day: date) -> float:
    """Count the days until the first certificate of a site expires; infinite without any."""
    until = (date.fromisoformat(each.until) for each in site.inventory.certificates) if site.inventory else ()
    return min(((each - day).days for each in until), default=inf)


def to_fix(site: SiteStatus) -> int:
    """Count what somebody should mend there; 0 if the site does not tell."""
    return site.inventory.to_fix if site.inventory else 0


def is_fine(site: SiteStatus, day: date) -> bool:
    """Tell whether nobody has to look at a site."""
    return site.state == "up" and not site.lines_down and not to_fix(site) and days_left(site, day) >= EARLY


def summary_of(sites: Sequence[SiteStatus], day: date) -> FleetSummary:
    """Count what the sites of a fleet have in common."""
    return FleetSummary(
        sites=len(sites),
        states=_counted(each.state for each in sites),
        lines_down=sum(bool(each.lines_down) for each in sites),
        to_fix=sum(to_fix(each) > 0 for each in sites),
        expiring=sum(days_left(each, day) < EARLY for each in sites),
        configs=_counted(each.inventory.config for each in sites if each.inventory),
        versions=_counted(each.version for each in sites),
    )


def _counted(names: Iterable[str]) -> list[tuple[str, int]]:
    return Counter(name for name in names if name).most_common()
