"""The reload of the config, as pages and the API order it."""

import asyncio
from collections.abc import Mapping
from typing import Any, Final

from gateway.web.api.answers import Answers
from gateway.web.front.problems import ProblemError

#: It takes no longer than this, in seconds.
RELOAD_TIME: Final = 85.0


async def reload(answers: Answers) -> Mapping[str, Any]:
    """Read the config again; what became of it.

    Raises:
        ProblemError: 503, the gateway is not ready.
    """
    try:
        async with asyncio.timeout(RELOAD_TIME):
            return await answers.reload()
    except TimeoutError:
        raise ProblemError(503, "the gateway is not ready") from None
