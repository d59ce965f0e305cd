"""What a gateway in virtual time answers to requests at its control socket."""

from collections.abc import AsyncGenerator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from gateway.control.server import carry_out
from gateway.errors import DaemonError, WrongQuestion
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker, IsThere
from gateway.operator.operator import Operator
from gateway.operator.units.units import picture
from gateway.operator.values.requests import AT_CONTROL
from gateway.runtime.running import Running
from kit.control import FakeConversation, Question

#: Of a gateway whose config is in no file.
_NOWHERE = Path("/nonexistent/gateway.toml")
NO_FILE = SimpleNamespace(file=_NOWHERE, place=str(_NOWHERE), fixed="", text="", applied_at=0.0, is_service=False)


def answering(
    running: Running, request: Mapping[str, Any], *, reloader: Any = NO_FILE, is_there: IsThere = lambda: True
) -> AsyncGenerator[Mapping[str, Any], None]:
    """The answers to a request as they come."""
    return carry_out(request, Operator(running, reloader), Asker(AT_CONTROL, is_there))


async def answers(
    running: Running, request: Mapping[str, Any], *, reloader: Any = NO_FILE, is_there: IsThere = lambda: True
) -> list[Mapping[str, Any]]:
    """All answers to a request: most have one."""
    return [each async for each in answering(running, request, reloader=reloader, is_there=is_there)]


async def ask(running: Running, verb: str, *, reloader: Any = NO_FILE, **details: Any) -> Mapping[str, Any]:
    """The answer to a request that has one."""
    (answer,) = await answers(running, {"verb": verb, **details}, reloader=reloader)
    return answer


async def _no_turn() -> None:
    """Others have no turn: the loop does not go on meanwhile."""


class ControlSocket(FakeConversation):
    """The control socket of a gateway in virtual time: operations that only let others have their turns."""

    def __init__(self, running: Running, reloader: Any = NO_FILE) -> None:
        super().__init__(self._answers_to)
        self._running, self._reloader = running, reloader

    def _answers_to(self, question: Question) -> list[Mapping[str, Any]]:
        answer = ask(self._running, reloader=self._reloader, **question)
        try:
            with patch("gateway.clock.slices.turn", _no_turn):
                while True:
                    answer.send(None)
        except StopIteration as done:
            return [done.value]
        except WrongQuestion as wrong:
            raise DaemonError(f"the gateway says: {wrong}") from wrong


def pictured(running: Running, wanted: int | str) -> UnitPicture:
    """Describe the unit with this number or name."""
    return picture(Operator(running, NO_FILE), wanted)
