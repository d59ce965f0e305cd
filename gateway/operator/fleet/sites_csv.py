"""The sites of a fleet as CSV, for spreadsheets and scripts."""

from collections.abc import Iterable
from typing import Final

from gateway.fleet.status import SiteStatus
from gateway.operator.values.values_csv import csv_text, harmless

#: The columns: `for` is in seconds, times are RFC 3339 text, several things in a cell are parted by semicolons. What a
#: site does not tell is empty.
COLUMNS: Final = (
    *("site", "state", "for", "started", "host", "version", "lines_up", "lines_down", "units"),
    *("config", "applied", "to_fix", "notes", "worst", "examined", "expires", "certificates", "adapters"),
)


def sites_as_csv(sites: Iterable[SiteStatus]) -> str:
    """Write a row for each site, below the headings."""
    cells = ([harmless(cell) if isinstance(cell, str) else cell for cell in _cells(each)] for each in sites)
    return csv_text(COLUMNS, cells)


def _cells(each: SiteStatus) -> Iterable[str | float]:
    yield from (each.site, each.state, each.for_s, each.started, each.host, each.version, each.lines)
    yield from ("; ".join(each.lines_down), each.units)
    found = each.inventory
    if found is None:
        yield from [""] * 9
        return
    yield from (found.config, found.applied, found.to_fix, found.notes)
    yield "; ".join(f"{worst.about}: {worst.what}" for worst in found.worst)
    yield found.examined
    yield min((one.until for one in found.certificates), default="")
    yield "; ".join(f"{one.used_by} {one.key} {one.until}" for one in found.certificates)
    yield "; ".join(" ".join(filter(None, (one.line, one.port, one.driver, one.ids))) for one in found.adapters)
