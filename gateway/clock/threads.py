"""Threads for calls into drivers, which may never return."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from threading import Thread
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class ThreadPerCall(Executor):
    """An executor that runs each call in a new thread, named after its purpose.

    Not a pool: a driver that hangs would take a worker from other lines, and Python waits for a pool's workers before
    it exits.
    """

    def __init__(self, purpose: str) -> None:
        self._purpose = purpose

    def submit(self, call: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Start `call` now; the future gets what it returns or raises.

        It cannot be cancelled, not even before the thread runs: what `call` opens would be lost.
        """
        outcome: Future[T] = Future()
        outcome.set_running_or_notify_cancel()
        job = partial(call, *args, **kwargs)
        Thread(target=_run, args=([job], outcome), name=self._purpose, daemon=True).start()
        return outcome


async def in_thread(purpose: str, call: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
    """Run a call in a new thread, named after its purpose; return what it returns, and raise what it raises."""
    return await asyncio.get_running_loop().run_in_executor(ThreadPerCall(purpose), partial(call, *args, **kwargs))


def _run(jobs: list[Callable[[], T]], outcome: Future[T]) -> None:
    try:
        result = jobs.pop()()  # what only this call has is freed before others go on
    except BaseException as error:  # noqa: BLE001 - raised again where the future is awaited
        outcome.set_exception(error)
    else:
        outcome.set_result(result)
