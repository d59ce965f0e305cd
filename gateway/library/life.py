"""The task of an embedded gateway, from its start to its end."""

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Final, TypeVar

from gateway.service.supervisor import Stop

T = TypeVar("T")


class Life:
    """Runs `work` in a task until `stop`. If it fails before, the task that made this is cancelled, as by a TaskGroup.

    `end` must follow.
    """

    def __init__(self, work: Coroutine[Any, Any, None], stop: Stop) -> None:
        owner = asyncio.current_task()
        assert owner is not None  # noqa: S101 - a coroutine makes it
        self._stop: Final = stop
        self._owner: Final = owner
        #: Whether the owner was cancelled because the work has failed.
        self._is_told = False
        self._task: Final = asyncio.create_task(work, name="gateway")
        self._task.add_done_callback(self._ended)

    async def end(self, error: BaseException | None) -> None:
        """Stop, and wait until all has ended; `error` is what ends the owner's work.

        When this is cancelled, requests in progress are not waited for; the rest is.

        Raises:
            Exception: what the work has failed with.
        """
        self._stop.order("closed")
        cancelled = None
        while not self._task.done():
            try:
                await asyncio.wait((self._task,))
            except asyncio.CancelledError as again:
                cancelled = again
                self._stop.order("cancelled")
        failure = None if self._task.cancelled() else self._task.exception()
        if self._is_told and asyncio.current_task() is self._owner:
            self._owner.uncancel()
            if error is None:
                with suppress(asyncio.CancelledError):  # it has not reached the owner's work
                    await asyncio.sleep(0)
        if failure is not None:
            raise failure from failure.__cause__
        if cancelled is not None:
            raise cancelled

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not self._stop.reason and not self._owner.done():
            self._is_told = not task.cancelled()
            self._owner.cancel("the gateway has failed")


async def unless(stop: Stop, work: asyncio.Future[T]) -> T:
    """Wait for what a thread does for the start, but no longer once there is the order to `stop`: it may never end.

    Raises:
        CancelledError: the order came.
    """
    ordered = asyncio.create_task(stop.wait(), name="stop")
    try:
        await asyncio.wait((work, ordered), return_when=asyncio.FIRST_COMPLETED)
    finally:
        ordered.cancel()
        work.cancel()
    return await work
