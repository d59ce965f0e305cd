"""Methods that can be awaited in the loop of another thread, too: they are carried out in the gateway's."""

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial, wraps
from typing import Any, Concatenate, Final, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_STOPPED: Final = "the gateway has stopped"
_STANDS_STILL: Final = "the event loop that the gateway was started in does not run: await this in that loop"


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
        return await _over(partial(method, self, *args, **named), self._loop)

    return from_anywhere


async def _over(begin: Callable[[], Coroutine[Any, Any, T]], loop: asyncio.AbstractEventLoop) -> T:
    """Carry out in another loop what `begin` begins there. What is cancelled before that loop comes to it never begins.

    Raises:
        RuntimeError: the loop does not run, or has ended meanwhile.
    """
    if not loop.is_running():
        raise RuntimeError(_STOPPED if loop.is_closed() else _STANDS_STILL)
    is_given_up = False

    async def unless_given_up() -> T:
        if is_given_up:
            raise asyncio.CancelledError
        return await begin()

    future = asyncio.run_coroutine_threadsafe(unless_given_up(), loop)
    try:
        return await asyncio.wrap_future(future)
    except asyncio.CancelledError:
        is_given_up = True
        task = asyncio.current_task()
        if task is not None and task.cancelling():
            raise
        raise RuntimeError(_STOPPED) from None  # its loop has cancelled all that was left
