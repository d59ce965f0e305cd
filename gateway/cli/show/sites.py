"""`check`: how long requests of other sites of the fleet may take here."""

from math import ceil
from typing import Any

from gateway.cli.kit.columns import align
from gateway.config.plan.forecast import least_timeouts_at_other_sites
from gateway.config.plan.settings import Plan, UpstreamPlan
from gateway.config.values.duration import show_duration
from gateway.ports.port import SiteSettings


def sites_as_text(plan: Plan) -> list[str]:
    """Show the shortest `timeout` that other sites need for each line and upstream, if there are other sites."""
    rows = [(name, show_duration(timeout)) for name, timeout in _timeouts(plan).items()]
    if plan.fleet is None or not rows:
        return []
    advice = f"  At other sites, the [[upstream]] to fleet://{plan.fleet.site} needs this timeout or a longer one."
    return ["\n".join(["Other sites", align([("UNITS OF", "TIMEOUT"), *rows], "  "), advice])]


def sites_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the same for programs; times are in milliseconds."""
    return [{"units_of": name, "timeout_ms": round(1000 * timeout)} for name, timeout in _timeouts(plan).items()]


def timeout_advice(plan: UpstreamPlan) -> list[str]:
    """Say where to find how long `timeout` must be, if units of another site are asked."""
    if not isinstance(plan.port, SiteSettings):
        return []
    return [f"  check at {plan.port.site} prints which timeout its units need."]


def _timeouts(plan: Plan) -> dict[str, float]:
    """Calculate the shortest time-outs, rounded up to tenths of seconds."""
    timeouts = {} if plan.fleet is None else least_timeouts_at_other_sites(plan)
    return {name: ceil(10 * timeout) / 10 for name, timeout in timeouts.items()}
