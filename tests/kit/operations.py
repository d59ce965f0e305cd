"""Operations that are none of a gateway, for tests of the doors."""

from dataclasses import dataclass

from gateway.operator.operation import Asker, Nothing, Operation
from gateway.operator.operator import Operator


@dataclass(frozen=True, slots=True)
class Told:
    """How it is."""

    status: str


async def status(_operator: Operator, _asked: Nothing, _asker: Asker) -> Told:
    return Told("fine")


async def defect(_operator: Operator, _asked: Nothing, _asker: Asker) -> Told:
    raise RuntimeError("nobody foresaw this")


STATUS_AND_DEFECT = {
    name: Operation(name, Nothing, "kit.operations:Told", "reading", f"Tell the {name}", by=f"kit.operations:{name}")
    for name in ("status", "defect")
}
