"""What a gateway in virtual time answers to requests at its control socket."""

from collections.abc import AsyncGenerator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gateway.control.server import carry_out
from gateway.operator.operation import Asker, IsThere
from gateway.operator.operator import Operator
from gateway.operator.requests import AT_CONTROL
from gateway.runtime.running import Running

#: Of a gateway whose config is in no file.
NO_FILE = SimpleNamespace(file=Path("/nonexistent/gateway.toml"))


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
