"""What `[fleet]` asks for: the servers of NATS, and the leases of lines."""

from dataclasses import replace

from gateway.config.plan.settings import FleetPlan, LeasePlan, Plan
from gateway.config.schema.config import Config
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.line import Line
from gateway.tls.settings import ClientTls


def add_fleet(plan: Plan, config: Config) -> Plan:
    """Add the way to other sites to a plan, if the config asks for it."""
    return plan if config.fleet is None else replace(plan, fleet=_fleet(config.site, config.fleet))


def lease_of(line: Line, config: Config) -> LeasePlan | None:
    """Describe the lease of a line; None for a line without one."""
    fleet = config.fleet
    if line.lease is None or fleet is None:
        return None
    return LeasePlan(line.lease, config.site, fleet.lease, fleet.fallback)


def _fleet(site: str, fleet: Fleet) -> FleetPlan:
    is_encrypted = any(server.scheme == "tls" for server in fleet.servers)
    return FleetPlan(
        site=site,
        servers=fleet.servers,
        user=fleet.user,
        password=fleet.password,
        credentials=fleet.credentials,
        tls=ClientTls(fleet.certificate, fleet.key, fleet.ca, "") if is_encrypted else None,
        lease=fleet.lease,
        fallback=fleet.fallback,
        source=fleet.place,
    )
