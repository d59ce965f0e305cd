"""Sites of a fleet, as they are known from their entries."""

from dataclasses import replace
from typing import Any

from gateway.fleet.inventory import SiteAdapter, SiteCertificate, SiteFinding, SiteInventory
from gateway.fleet.status import SiteStatus

INVENTORY = SiteInventory(
    config="634c3833bedd",
    applied="2026-05-01T12:00:00Z",
    adapters=(SiteAdapter("hall", "/dev/serial/by-id/usb-FTDI-if00", "ftdi_sio", "0403:6001"),),
    certificates=(SiteCertificate("scada", "certificate", "2027-05-01"), SiteCertificate("scada", "ca", "2036-05-01")),
    to_fix=0,
    notes=1,
    worst=(),
    examined="2026-05-01T12:05:00Z",
)
TO_FIX = replace(INVENTORY, to_fix=2, worst=(SiteFinding("unit silo", "does not answer <now>"),))


def site(name: str, **changed: Any) -> SiteStatus:
    """A site that is fine, but for what is changed."""
    fine = SiteStatus(name, "up", 90.0, "2026-05-01T12:00:00Z", f"gw-{name}", "0.1.0", 2, (), 7, inventory=INVENTORY)
    return replace(fine, **changed)
