"""Cross-checks of what the config asks of its lines."""

from collections.abc import Iterator

from gateway.config.plan.line_load import FULL, load_of, total_share
from gateway.config.plan.reach import client_lines
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, warning
from gateway.config.schema.config import Config


def check_load(config: Config, plan: Plan) -> Iterator[Problem]:
    """Find lines that have no time for anything but their declared polls."""
    for line, line_plan in zip(client_lines(config), plan.lines, strict=True):
        share = total_share(load_of(line_plan, plan))
        if share >= FULL:
            what = f"the polls of {_pollers(config)} need {share:.0%} of its time"
            yield warning(line.path, what, "poll less often, or raise the rate of the line")


def _pollers(config: Config) -> str:
    has_mirrors = any(image.of is not None for image in config.image)
    return " and ".join([*(["mirrors"] if has_mirrors else []), *(["MQTT"] if config.mqtt else [])])
