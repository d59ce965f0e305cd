"""The sections of a config that add a part to the gateway: all that the rest of this package knows of them.

A new one has its keys in `schema` and a field in `schema/config.py`, its checks in `checks`, what makes its plan in
`plan`, and a row here. What it does while the gateway runs: `runtime/add_ons.py`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from gateway.config.checks.fleet import check_fleet
from gateway.config.checks.mqtt import check_mqtt, check_published
from gateway.config.checks.times import check_lease
from gateway.config.checks.web import check_web
from gateway.config.plan.add_ons import add_fleet, add_mqtt, add_web
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem
from gateway.config.schema.config import Config
from gateway.config.schema.table import Table
from gateway.config.values.reserved_names import FLEET, MQTT, WEB


def _nothing(_config: Config, _plan: Plan) -> Iterator[Problem]:
    """Find nothing in the plan."""
    yield from ()


@dataclass(frozen=True, slots=True)
class AddOn:
    """A section by its `key`, which is also the name of the extra with its libraries.

    `check` looks at its keys, beside those of other sections; its second argument is the set of sections that failed.
    `add` adds its part to a plan that has everything else. `check_plan` looks at the plan of a config without errors.
    `files` are the keys that name files with secrets or users. `loss` says what is lost without one of these.
    """

    key: str
    check: Callable[[Config, frozenset[str]], Iterator[Problem]]
    add: Callable[[Plan, Config], Plan]
    files: tuple[str, ...]
    loss: str
    check_plan: Callable[[Config, Plan], Iterator[Problem]] = _nothing

    def table(self, config: Config) -> Table | None:
        """Find its table; None if the config has none."""
        table: Table | None = getattr(config, self.key)
        return table


#: Each adds to a plan that has what stands before it.
ADD_ONS: Final = (
    AddOn(WEB, check_web, add_web, ("users", "token"), "there will be no web page"),
    AddOn(MQTT, check_mqtt, add_mqtt, ("password",), "nothing will be published", check_published),
    AddOn(FLEET, check_fleet, add_fleet, ("password", "credentials"), "other sites cannot be reached", check_lease),
)
