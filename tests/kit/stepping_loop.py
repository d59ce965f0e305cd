"""An event loop in virtual time that can be interfered with at each step, and what is left behind in it."""

import asyncio
import gc
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kit.virtual_time import VirtualTimeLoop

#: So many virtual seconds after the end nothing may be scheduled any more.
LATER = 3600.0

#: What a thread closes, in a moment: the kernel lets it wait.
CLOSED_SOON = {"anon_inode:inotify"}

Main = asyncio.Task[Any]
#: Called before each step, with its number and the main task.
Act = Callable[[int, Main], object]


class SteppingLoop(VirtualTimeLoop):
    """Calls `act` before each step. Descriptors are accepted, and nothing ever comes by them.

    Jobs of executors are done at once, as in virtual time, but what awaits them is told three steps later.
    """

    def __init__(self) -> None:
        super().__init__()
        self._clock.accepts_descriptors = True
        self.steps = 0
        self.act: Callable[[int], object] = lambda _: None
        self.complaints: list[str] = []
        self.set_exception_handler(lambda _, context: self.complaints.append(str(context)))

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:
        done, told = super().run_in_executor(executor, func, *args), self.create_future()
        self.call_soon(self.call_soon, self.call_soon, asyncio.futures._chain_future, done, told)
        return told

    @property
    def watched(self) -> int:
        """How many descriptors the loop waits for, beside its own."""
        return len(self._clock.get_map()) - 1

    @property
    def timers(self) -> list[str]:
        """What will be called at some time."""
        return [repr(handle) for handle in self._scheduled if not handle.cancelled()]

    def _run_once(self) -> None:
        self.steps += 1
        self.act(self.steps)
        super()._run_once()


@dataclass
class Run:
    """What a run has returned or raised, how many steps it took, and what it `left` behind when it had ended.

    The loop adds `complaints`, some of them once what was left is freed.
    """

    steps: int = 0
    outcome: Any = None
    left: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


def run(main: Coroutine[Any, Any, Any], act: Act = lambda step, task: None) -> Run:
    """Run `main` in a stepping loop that `act` interferes with, until the main task has ended."""
    before, found = descriptors(), Run()
    loop = SteppingLoop()
    try:
        task = loop.create_task(main, name="main")
        own = set(descriptors().values()) - set(before.values())

        def ended(_: object) -> None:
            found.steps, loop.act = loop.steps, lambda _: None
            found.left += [repr(each) for each in asyncio.all_tasks(loop) if each is not waiting]
            found.left += [f"watches {loop.watched} descriptors"] * bool(loop.watched)
            found.left += sorted(set(descriptors().values()) - set(before.values()) - own - CLOSED_SOON)

        task.add_done_callback(ended)
        loop.act = lambda step: act(step, task)
        waiting = loop.create_task(asyncio.wait((task,)), name="waiting")
        loop.run_until_complete(waiting)
        found.outcome = asyncio.CancelledError() if task.cancelled() else task.exception() or task.result()
        loop.run_until_complete(asyncio.sleep(LATER))
        found.left += loop.timers
    finally:
        loop.close()
    found.complaints = loop.complaints
    return found


def ends_of(main: Callable[[], Coroutine[Any, Any, Any]], interfere: Callable[[int], Act], every: int = 1) -> list[str]:
    """Run `main` again and again, and `interfere` at its first step, at the next one and so on, until it has ended.

    Return what was left, and outcomes other than that it was cancelled. Only `every` so many steps are tried.
    """
    wrong, runs, at = [], [], 0
    while True:
        at += every
        found = run(main(), interfere(at))
        runs.append(found)
        wrong += [f"step {at}: {each}" for each in found.left]
        if found.steps <= at:
            break
        if not isinstance(found.outcome, asyncio.CancelledError):
            wrong.append(f"step {at}: {found.outcome!r}")
    gc.collect()  # tasks and futures that nobody has awaited complain now
    return wrong + [each for found in runs for each in found.complaints]


def descriptors() -> dict[int, str]:
    """Tell what each open descriptor of this process leads to."""
    found = {}
    for each in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # that of the list itself
            found[int(each.name)] = str(each.readlink())
    return found
