"""The operations `which` and `reload`."""

import asyncio
from dataclasses import asdict
from typing import Final

from gateway.errors import Unready
from gateway.operator.operations.answers.running import Reloaded, Which
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operator import Operator

#: How long a reload is waited for, in seconds: clients wait for 90. It goes on afterwards.
RELOAD_TIME: Final = 85.0


async def tell_which(operator: Operator, _asked: Nothing, _asker: Asker) -> Which:
    """Return the config file of the running gateway."""
    return Which(operator.reloader.place)


async def reload(operator: Operator, _asked: Nothing, _asker: Asker) -> Reloaded:
    """Read the config again, and apply it.

    Raises:
        Unready: the reload has not ended within RELOAD_TIME, and goes on; or the config comes from a program.
    """
    if operator.reloader.fixed:
        raise Unready(operator.reloader.fixed)
    try:
        async with asyncio.timeout(RELOAD_TIME):
            outcome = await asyncio.shield(operator.reloader.order())
    except TimeoutError:
        raise Unready(f"the reload has not ended within {RELOAD_TIME:g} s; the log says what becomes of it") from None
    is_done = not (outcome.problems or outcome.defect)
    return Reloaded(**asdict(outcome), ok=is_done, file=operator.reloader.place)
