"""Operations that are none of a gateway, for tests of the doors."""

from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Annotated

from gateway.errors import DoesNotFit
from gateway.operator.operations.operation import Asker, Nothing, Operation
from gateway.operator.operations.parameters import Within
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


@dataclass(frozen=True, slots=True)
class ToRepeat:
    """The `word` to say some `times`."""

    word: Annotated[str, "a word"]
    times: Annotated[int, Within(1, 9), "a whole number from 1 to 9"] = 2


@dataclass(frozen=True, slots=True)
class Repeated:
    """What was said, and to which client."""

    words: tuple[str, ...]
    client: str


async def repeat(_operator: Operator, asked: ToRepeat, asker: Asker) -> Repeated:
    if asked.word == "hush":
        raise DoesNotFit("hush is not said aloud")
    return Repeated((asked.word,) * asked.times, asker.caller.client)


#: An operation that somebody has added: this row, the two types above it and its function are all that it needs.
REPEAT: Operation[ToRepeat, Repeated] = Operation(
    "repeat",
    ToRepeat,
    "kit.operations:Repeated",
    "reading",
    "Say a word again",
    by="kit.operations:repeat",
    path="/words/{word}",
    refuses=(DoesNotFit,),
)
