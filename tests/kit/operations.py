"""Operations that are none of a gateway, for tests of the doors."""

from collections.abc import AsyncGenerator
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


async def several(_operator: Operator, _asked: Nothing, _asker: Asker) -> AsyncGenerator[Told, None]:
    yield Told("begun")
    yield Told("done")


SEVERAL = Operation(
    "several", Nothing, "kit.operations:Told", "reading", "Tell how it goes", "kit.operations:several", is_repeated=True
)
STATUS_AND_DEFECT = {
    name: Operation(name, Nothing, "kit.operations:Told", "reading", f"Tell the {name}", by=f"kit.operations:{name}")
    for name in ("status", "defect")
}
