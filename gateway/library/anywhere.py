"""Methods that can be awaited in the loop of another thread, too: they are carried out in the gateway's."""

import asyncio
from collections.abc import Callable, Coroutine
from functools import wraps
from typing import Any, Concatenate, Final, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_STOPPED: Final = "the gateway has stopped"


class _HasLoop(Protocol):
    _loop: asyncio.AbstractEventLoop


S = TypeVar("S", bound=_HasLoop)


def anywhere(
    method: Callable[Concatenate[S, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[S, P], Coroutine[Any, Any, T]]:
    """Let a method of an object with a `_loop` be awaited in any loop. Cancelling there cancels it here."""

    @wraps(method)
    async def from_anywhere(self: S, /, *args: P.args, **named: P.kwargs) -> T:
        if asyncio.get_running_loop() is self._loop:
            return await method(self, *args, **named)
        return await _over(method(self, *args, **named), self._loop)

    return from_anywhere


async def _over(work: Coroutine[Any, Any, T], loop: asyncio.AbstractEventLoop) -> T:
    """Carry out `work` in another loop.

    Raises:
        RuntimeError: the loop does not run, or has ended meanwhile.
    """
    if not loop.is_running():
        work.close()
        raise RuntimeError(_STOPPED)
    future = asyncio.run_coroutine_threadsafe(work, loop)
    try:
        return await asyncio.wrap_future(future)
    except asyncio.CancelledError:
        task = asyncio.current_task()
        if task is not None and task.cancelling():
            raise
        raise RuntimeError(_STOPPED) from None  # its loop has cancelled all that was left
