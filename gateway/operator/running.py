"""The operations `which`, `fleet` and `reload`."""

import asyncio
from dataclasses import asdict
from typing import Final

from gateway.errors import FleetError, Unready, WrongQuestion
from gateway.operator.answers.running import Reloaded, Which
from gateway.operator.answers.status import Sites
from gateway.operator.operation import Asker, Nothing
from gateway.operator.operator import Operator

#: A reload takes no longer than this, in seconds.
RELOAD_TIME: Final = 85.0


async def tell_which(operator: Operator, _asked: Nothing, _asker: Asker) -> Which:
    """Return the config file of the running gateway."""
    return Which(str(operator.reloader.file.absolute()))


async def tell_sites(operator: Operator, _asked: Nothing, _asker: Asker) -> Sites:
    """Return what the sites of the fleet report about themselves.

    Raises:
        WrongQuestion: they are not known.
    """
    try:
        return Sites(tuple(await operator.running.add_ons.fleet.sites()))
    except FleetError as error:
        raise WrongQuestion(f"the other sites are not known: {error}") from error


async def reload(operator: Operator, _asked: Nothing, _asker: Asker) -> Reloaded:
    """Read the config again, and apply it.

    Raises:
        Unready: the gateway is starting or stopping, and does not reload within RELOAD_TIME.
    """
    try:
        async with asyncio.timeout(RELOAD_TIME):
            outcome = await asyncio.shield(operator.reloader.order())
    except TimeoutError:
        raise Unready("the gateway is not ready") from None
    is_done = not (outcome.problems or outcome.defect)
    return Reloaded(**asdict(outcome), ok=is_done, file=str(operator.reloader.file.absolute()))
