"""An operation: one thing that can be asked of a running gateway, as data.

The control socket, HTTP with its OpenAPI document, and the command line are built from the table of all operations
(`table.py`). The function that carries out an operation is loaded on first use:

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

#: What an operation needs: to see how the gateway is doing, to change it, or to write values, which `[web]` allows only
#: with `write`.
Right = Literal["reading", "operator", "writing"]
#: The HTTP method of an operation.
Method = Literal["GET", "PUT", "POST"]
#: Returns whether the asker is still connected.
IsThere = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Nothing:
    """The parameters of an operation that has none."""


@dataclass(frozen=True, slots=True)
class Asker:
    """The client that asks, and the door that it uses.

    Over HTTP, values that [[access]] does not let the address `host` read are hidden. At the control socket `host` is
    empty: everyone who may use the socket sees everything.
    """

    caller: "Caller"
    is_there: IsThere
    host: str = ""
    door: "Door" = "control"


@dataclass(frozen=True)
class Operation(Generic[P, R]):
    """One thing that can be asked: its `parameters` and its `result` are dataclasses.

    `result_at` is where the type of the result is, and `by` the function that answers, as `module:name`; both are
    loaded on first use. At the control socket the result is under `key`, or its fields are beside `ok` if `key` is
    empty. Over HTTP it is at `path` below /api/v1, where `{name}` is a parameter; an operation without a path is not
    available there. One that `is_repeated` has several answers, and one that `is_large` an answer of thousands of
    objects, which are made without waiting for anything.

    `refuses` are possible errors besides wrong parameters and missing rights.
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
    is_large: bool = False
    refuses: tuple[type[WrongQuestion], ...] = ()

    @cached_property
    def result(self) -> type[R]:
        """The type of the result, loaded on first use."""
        result: type[R] = _load(self.result_at)
        return result

    @cached_property
    def function(self) -> "Callable[[Operator, P, Asker], Any]":
        """The function that answers, loaded on first use."""
        function: Callable[[Operator, P, Asker], Any] = _load(self.by)
        return function

    async def load(self) -> None:
        """Load the function that answers in a thread, if it is not yet: the lines do not wait for that."""
        if "function" not in self.__dict__:
            import asyncio  # noqa: PLC0415 - commands, which only ask, do without

            from gateway.clock.threads import ThreadPerCall  # noqa: PLC0415

            await asyncio.get_running_loop().run_in_executor(ThreadPerCall("load operation"), lambda: self.function)

    async def answer(self, operator: "Operator", asked: P, asker: Asker) -> R:
        """Carry out an operation that has one answer.

        Raises:
            WrongQuestion: it cannot be carried out.
        """
        answer: R = await self.function(operator, asked, asker)
        return answer

    def answers(self, operator: "Operator", asked: P, asker: Asker) -> AsyncGenerator[R, None]:
        """Carry out an operation that `is_repeated`, until the generator is closed.

        Raises:
            WrongQuestion: it cannot be carried out.
        """
        answers: AsyncGenerator[R, None] = self.function(operator, asked, asker)
        return answers


def _load(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
