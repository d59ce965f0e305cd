"""An operation: one thing that may be asked of a gateway at work, as data.

The control socket, HTTP with its OpenAPI document, and the command line are made of the table of all operations
(`operations.py`). What an operation does is a function that is loaded when it is asked for the first time:

    async def forget(operator: Operator, asked: Device, asker: Asker) -> Forgotten

An operation with several answers is an asynchronous generator of them.
"""

from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from gateway.errors import WrongQuestion

if TYPE_CHECKING:
    from gateway.operator.operator import Door, Operator
    from gateway.request import Caller

P = TypeVar("P")
R = TypeVar("R")

#: What is needed for an operation: to see how the gateway is doing, to change it, or to write values, which `[web]`
#: allows only with `write`.
Right = Literal["reading", "operator", "writing"]
#: Over HTTP, how an operation is asked for.
Method = Literal["GET", "PUT", "POST"]
#: Whether who asks is still there.
IsThere = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Nothing:
    """The parameters of an operation that has none."""


@dataclass(frozen=True, slots=True)
class Asker:
    """Who asks, and through which door.

    Over HTTP what [[access]] does not let the address `host` read is hidden. At the control socket that is empty:
    whoever may use the socket sees everything.
    """

    caller: "Caller"
    is_there: IsThere
    host: str = ""
    door: "Door" = "control"


@dataclass(frozen=True)
class Operation(Generic[P, R]):
    """One thing that may be asked: its `parameters` and its `result` are dataclasses.

    `result_at` is where the type of the result is, and `by` the function that answers, as `module:name`: what only asks
    starts without them. At the control socket the result stands under `key`, or its fields beside `ok` where `key` is
    empty. Over HTTP it is at `path` below /api/v1, where `{name}` is a parameter; an operation without a path is not to
    be had there. One that `is_repeated` has several answers, one after the other.

    `refuses` are the errors, beside wrong parameters and missing rights, for which it is not carried out.
    """

    name: str
    parameters: type[P]
    result_at: str
    right: Right
    summary: str
    by: str
    key: str = ""
    path: str | None = None
    method: Method = "GET"
    is_repeated: bool = False
    refuses: tuple[type[WrongQuestion], ...] = ()

    @cached_property
    def result(self) -> type[R]:
        """Load the type of the result."""
        result: type[R] = _load(self.result_at)
        return result

    @cached_property
    def function(self) -> "Callable[[Operator, P, Asker], Any]":
        """Load the function that answers."""
        function: Callable[[Operator, P, Asker], Any] = _load(self.by)
        return function

    async def answer(self, operator: "Operator", asked: P, asker: Asker) -> R:
        """Answer an operation that has one answer.

        Raises:
            WrongQuestion: it cannot be carried out.
        """
        answer: R = await self.function(operator, asked, asker)
        return answer

    def answers(self, operator: "Operator", asked: P, asker: Asker) -> AsyncGenerator[R, None]:
        """Answer an operation that `is_repeated`, for as long as the answers are taken.

        Raises:
            WrongQuestion: it cannot be carried out.
        """
        answers: AsyncGenerator[R, None] = self.function(operator, asked, asker)
        return answers


def _load(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
