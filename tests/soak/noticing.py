"""Whether a run notices what is wrong. It ends with the first answer that is: any that follow would show no more."""

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from typing import Any
from unittest.mock import patch

from soak.tally import Tally


async def is_noticed(play: Callable[[int], Coroutine[Any, Any, Tally]], seeds: Iterable[int] = (1, 2, 3)) -> bool:
    """Play with one seed after the other until there is a complaint; whether there is one.

    What is wrong shows in rare orders only, and each change of a time anywhere gives a seed other orders.
    """
    for seed in seeds:
        if await _complains(play(seed)):
            return True
    return False


async def _complains(run: Coroutine[Any, Any, Tally]) -> bool:
    playing = asyncio.ensure_future(run)
    with patch.object(Tally, "complain", lambda *_: playing.cancel()):
        await asyncio.wait([playing])
    return playing.cancelled() or playing.result().wrong_count > 0
