"""The state that outlives the process: what a gateway finds of earlier runs, and leaves to the next one."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gateway.images.drivers.store import Store
from gateway.runtime.overdue import FILE_NAME as LATE_FILE
from gateway.runtime.overdue import LeftBehind, is_entry
from gateway.state.entry_file import EntryFile, IsEntry
from gateway.state.memory import Memory, StateFile
from gateway.state.troubles import StateTroubles


def _open_nothing(_name: str, _is_entry: IsEntry) -> None:
    """Keep nothing."""


@dataclass(frozen=True, kw_only=True)
class KeptState:
    """The kept state: in memory only, unless parts are given that write to the state folder.

    `memory` has where devices have moved to; `left_behind` has late responses that may still arrive on ports of earlier
    lines. Persistent images need a `store`. `troubles` are those with the folder. Add-ons open files with `open_file`,
    which returns None without a folder, or write in the `folder` themselves.
    """

    memory: Memory = field(default_factory=Memory)
    left_behind: LeftBehind = field(default_factory=LeftBehind)
    open_file: Callable[[str, IsEntry], EntryFile | None] = _open_nothing
    store: Store | None = None
    folder: Path | None = None
    troubles: StateTroubles | None = None


@contextmanager
def state_kept(folder: Path, troubles: StateTroubles) -> Iterator[KeptState]:
    """Keep the state in files of this `folder` inside the context. Trouble with them is told by events.

    Blocks at both ends: the disk gets 3 s at the end for what is not written yet.
    """
    troubles.look()
    emit = troubles.emit
    with (
        closing(StateFile(folder, emit)) as memory,
        closing(LeftBehind(EntryFile(folder / LATE_FILE, is_entry, emit))) as left_behind,
        ExitStack() as opened,
        closing(Store(folder, emit)) as store,  # closed first: meanwhile the other files are written
    ):

        def open_file(name: str, is_entry: IsEntry) -> EntryFile:
            return opened.enter_context(closing(EntryFile(folder / name, is_entry, emit)))

        yield KeptState(
            memory=memory,
            left_behind=left_behind,
            store=store,
            troubles=troubles,
            open_file=open_file,
            folder=folder,
        )
