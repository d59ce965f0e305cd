"""Tasks beside others: each ends with what it serves, and a defect in one ends no other."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any

from gateway.events import Emit, PartFailed

Work = Callable[[], Awaitable[object]]


@asynccontextmanager
async def beside(works: Mapping[str, Work], emit: Emit) -> AsyncIterator[None]:
    """Run `works`, by their names, beside the context; its end cancels them. A defect in one ends only that one."""
    tasks = [asyncio.create_task(guarded(name, work, emit), name=name) for name, work in works.items()]
    try:
        yield
    finally:
        await end(*tasks)


async def end(*tasks: asyncio.Task[Any]) -> None:
    """Cancel tasks, and wait until they have ended. What they raise is dropped."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def guarded(name: str, work: Work, emit: Emit) -> None:
    """Do `work`; a defect in it is told, and not raised."""
    try:
        await work()
    except Exception as error:  # noqa: BLE001 - an error boundary: all others go on
        emit(PartFailed.of(name, error))
