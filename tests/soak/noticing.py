"""Whether a run notices what is wrong. It ends with the first answer that is: any that follow would show no more."""

import asyncio
from collections.abc import Coroutine
from typing import Any
from unittest.mock import patch

from soak.tally import Tally


async def is_noticed(run: Coroutine[Any, Any, Tally]) -> bool:
    """Play a run until it has a complaint; whether it has one."""
    playing = asyncio.ensure_future(run)
    with patch.object(Tally, "complain", lambda *_: playing.cancel()):
        await asyncio.wait([playing])
    return playing.cancelled() or playing.result().wrong_count > 0
