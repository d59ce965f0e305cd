"""What an embedded gateway keeps in a folder. It is opened and closed in threads: the program's loop goes on."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, asynccontextmanager, nullcontext
from pathlib import Path
from typing import Final, TypeVar

from gateway.clock.threads import ThreadPerCall
from gateway.config.plan.settings import Plan
from gateway.errors import StateError
from gateway.events import Emit
from gateway.runtime.kept_state import KeptState, state_kept
from gateway.runtime.remembered import in_force
from gateway.service.supervisor import Stop
from gateway.state import files
from gateway.state.troubles import StateTroubles

T = TypeVar("T")

#: Locked while a gateway of a program uses the folder.
_LOCK: Final = "embedded.lock"
#: How long a start that is to stop again waits for the disk, in seconds.
_PATIENCE: Final = 1.0


@asynccontextmanager
async def state_open(folder: Path | None, plan: Plan, emit: Emit, stop: Stop) -> AsyncIterator[KeptState]:
    """Keep the state in files of this `folder` inside the context, as the daemon does; without one, in memory.

    What changes at the end is written before it returns, or is cancelled: that takes 3 s at most.

    Raises:
        CancelledError: the order to `stop` came while it was being opened.
        StateError: another gateway uses the folder, or a later version has written what images of the `plan` keep.
    """
    if folder is None:
        yield KeptState()
        return
    opened = ExitStack()
    opening = ThreadPerCall("open state").submit(_open, folder, plan, emit, opened)
    kept = await _opened(opening, opened, stop)
    try:
        yield kept
    finally:
        if kept.store is not None:
            kept.store.begin_closing()
        await _to_its_end(ThreadPerCall("close state").submit(opened.close))


def _open(folder: Path, plan: Plan, emit: Emit, opened: ExitStack) -> KeptState:
    troubles = StateTroubles(folder, emit)
    with ExitStack() as unless_open:
        unless_open.enter_context(_alone_in(folder))
        kept = unless_open.enter_context(state_kept(folder, troubles))
        if kept.store is not None and plan.has_kept_images:
            kept.store.open()
        for remembered in in_force(plan, kept.memory):
            emit(remembered)
        opened.enter_context(unless_open.pop_all())
    return kept


def _alone_in(folder: Path) -> AbstractContextManager[object]:
    """Lock the folder. If nothing can be written there, nothing is locked; events tell of that.

    Raises:
        StateError: another gateway uses it.
    """
    try:
        return files.lock(folder / _LOCK)
    except BlockingIOError:
        raise StateError(f"{folder} is in use by another gateway: give each a folder of its own") from None
    except OSError:
        return nullcontext()


async def _opened(opening: Future[KeptState], opened: ExitStack, stop: Stop) -> KeptState:
    """Wait until all is open; if that is not wanted any more, the thread closes all again."""
    waiting, ordered = asyncio.wrap_future(opening), asyncio.create_task(stop.wait(), name="stop")

    def give_up() -> None:
        opening.add_done_callback(lambda _: opened.close())
        if not waiting.cancel():
            waiting.exception()  # nobody else asks for it

    try:
        await asyncio.wait((waiting, ordered), return_when=asyncio.FIRST_COMPLETED)
        if not waiting.done():
            await asyncio.wait((waiting,), timeout=_PATIENCE)
    except asyncio.CancelledError:
        give_up()
        raise
    finally:
        ordered.cancel()
    if not waiting.done():
        give_up()
    return await waiting


async def _to_its_end(work: Future[T]) -> T:
    """Wait until a thread has done its work, also if this is cancelled."""
    waiting, cancelled = asyncio.wrap_future(work), None
    while not waiting.done():
        try:
            await asyncio.wait((waiting,))
        except asyncio.CancelledError as again:
            cancelled = again
    if cancelled is not None:
        raise cancelled
    return waiting.result()
