"""A thread with an event loop of its own, for code that may block."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from threading import BoundedSemaphore, Lock, Thread
from typing import Any, Final, ParamSpec, TypeVar

from gateway.clock.threads import ThreadPerCall

P = ParamSpec("P")
T = TypeVar("T")

#: How many threads what it carries out may have at once, by `asyncio.to_thread`.
MOST_THREADS: Final = 64
#: How long the thread may take to end, in seconds.
ENDING_TIME: Final = 1.0


class LoopThread:
    """A thread named `name`, which is started by the first call, and carries out calls in its event loop.

    If what it carries out ends that loop, it goes on: others have calls there.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: Thread | None = None
        self._starting = Lock()
        self._is_closed = False

    def call_soon(self, call: Callable[..., object], *arguments: Any) -> None:
        """Have the thread call `call`, from any thread. After `close` nothing is called.

        Raises:
            RuntimeError: no thread can be started.
        """
        with self._starting:
            if self._is_closed:
                return
            if self._loop is None:
                loop = _Loop()
                self._thread = Thread(target=self._run, args=(loop,), name=self._name, daemon=True)
                try:
                    self._thread.start()
                except RuntimeError:
                    loop.close()
                    raise
                self._loop = loop
        with suppress(RuntimeError):  # it is closed
            self._loop.call_soon_threadsafe(call, *arguments)

    async def close(self) -> bool:
        """End the thread; its tasks are cancelled. Return False if it does not end in ENDING_TIME: then it is left.

        Python does not wait for it at its exit.
        """
        self._is_closed = True
        if self._loop is None or self._thread is None:
            return True
        with suppress(RuntimeError):  # it is closed already
            self._loop.call_soon_threadsafe(self._loop.stop)
        waiting = ThreadPerCall(f"end of {self._name}")
        await asyncio.get_running_loop().run_in_executor(waiting, self._thread.join, ENDING_TIME)
        return not self._thread.is_alive()

    def _run(self, loop: asyncio.AbstractEventLoop) -> None:
        """Run a loop until `close`; then end what it still has, and close it."""
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.get_loop()
            while not self._is_closed:
                with suppress(SystemExit, KeyboardInterrupt):  # of what it carries out
                    loop.run_forever()


class _Threads(ThreadPerCall):
    """At most MOST_THREADS at once: what hangs for good, again and again, must not take all that the process has."""

    def __init__(self) -> None:
        super().__init__("asyncio")
        self._free: Final = BoundedSemaphore(MOST_THREADS)

    def submit(self, call: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Start `call` now.

        Raises:
            RuntimeError: so many have not ended yet, or no thread can be started.
        """
        if not self._free.acquire(blocking=False):
            raise RuntimeError(f"{MOST_THREADS} calls of asyncio.to_thread have not ended yet")
        try:
            outcome = super().submit(call, *args, **kwargs)
        except BaseException:
            self._free.release()
            raise
        outcome.add_done_callback(lambda _: self._free.release())
        return outcome


class _Loop(asyncio.SelectorEventLoop):
    """An event loop whose usual executor has no threads that Python would wait for at its exit."""

    def __init__(self) -> None:
        super().__init__()
        self._threads: Final = _Threads()

    def run_in_executor(  # type: ignore[override]  # mypy knows no *args of the kind that its stub has
        self, executor: Executor | None, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        """Run `func` in a thread."""
        return super().run_in_executor(executor or self._threads, func, *args)
