"""The head of every page: whose gateway it is, how it is doing, and its clock."""

from dataclasses import dataclass
from datetime import datetime
from socket import gethostname
from typing import Final

from gateway.operator.operator import Operator
from gateway.web.access.guard import Visitor
from gateway.web.pages.situation import Situation, Situations

#: What the page is called where nothing else may be told.
_NAME: Final = "modbus-gateway"


@dataclass(frozen=True, slots=True)
class Head:
    """The `name` of the plant, or else of the machine. `now` is the time of the gateway, with its zone.

    Whoever may not read anything has no `situation`, and learns neither how the gateway is doing nor on which machine.
    """

    name: str
    now: datetime
    situation: Situation | None
    has_fleet: bool = False

    @property
    def zone(self) -> str:
        """The time zone: its name, or its distance from UTC if it has none."""
        name = self.now.tzname() or ""
        return f"UTC{name}" if name.startswith(("+", "-")) else name


class Heads:
    """Makes the head of each page of a gateway."""

    def __init__(self, operator: Operator, situations: Situations) -> None:
        self._operator = operator
        self._situations = situations

    async def of(self, visitor: Visitor) -> Head:
        """Make the head of a page for a visitor."""
        site = self._operator.gateway.plan.site
        now = datetime.fromtimestamp(self._operator.clock()).astimezone()
        if not visitor.may_read:
            return Head(site or _NAME, now, None)
        has_fleet = self._operator.gateway.plan.fleet is not None
        return Head(site or gethostname(), now, await self._situations.now(), has_fleet)
