"""The sites of a fleet, as `status --fleet` shows them."""

from typing import Final

from gateway.cli.kit.table import Table
from gateway.cli.show.status_tables import painted
from gateway.config.values.duration import show_age
from gateway.fleet.status import SiteStatus
from gateway.operator.answers.status import Sites

SITES: Final = Table[Sites, SiteStatus](
    "Sites",
    lambda sites: sites.sites,
    {
        "SITE": lambda site: site.site,
        "STATE": lambda site: painted(site.state),
        "FOR": lambda site: show_age(1000 * site.for_s),
        "HOST": lambda site: site.host,
        "LINES UP": lambda site: site.lines,
        "DOWN": lambda site: ", ".join(site.lines_down) or "-",
        "UNITS": lambda site: site.units,
        "VERSION": lambda site: site.version,
    },
)
