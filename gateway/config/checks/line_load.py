"""Cross-checks of what the config asks of its lines and upstreams."""

from collections.abc import Iterator

from gateway.config.plan.line_load import FULL, load_of, total_share
from gateway.config.plan.names import owners
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, warning
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line


def check_load(config: Config, plan: Plan) -> Iterator[Problem]:
    """Find lines and upstreams that have no time for anything but their declared polls."""
    for owner, of_plan in zip(owners(config), plan.owners, strict=True):
        load = load_of(of_plan, plan)
        share = total_share(load)
        if share >= FULL:
            at_least = "" if all(each.has_time for each in load) else "at least "
            what = f"the polls of {_pollers(config)} need {at_least}{share:.0%} of its time"
            faster = ", or raise the rate of the line" if isinstance(owner, Line) else ""
            yield warning(owner.path, what, f"poll less often{faster}")


def _pollers(config: Config) -> str:
    pollers = {
        "mirrors": any(image.of is not None for image in config.image),
        "virtual units": any(image.map for image in config.image),
        "MQTT": config.mqtt is not None,
    }
    return " and ".join(name for name, polls in pollers.items() if polls)
