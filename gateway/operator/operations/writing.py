"""Writes answers as JSON for the doors: a long one in a thread, for which the lines do not wait."""

import asyncio
from functools import partial

from gateway.clock.slices import with_rests
from gateway.clock.threads import ThreadPerCall
from gateway.operator.operations.json_text import Write, has_long_lists, json_text


async def written(answer: object, write: Write) -> bytes:
    """Write an answer in UTF-8. A thread costs more than most answers: others are written at once."""
    if not has_long_lists(answer):
        return json_text(answer, write)
    call = partial(json_text, answer, write, with_rests)
    del answer
    return await asyncio.get_running_loop().run_in_executor(ThreadPerCall("answer"), call)
