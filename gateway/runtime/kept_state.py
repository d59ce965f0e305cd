"""The state that outlives the process: what a gateway finds of earlier runs, and leaves to the next one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gateway.images.drivers.store import Store
from gateway.runtime.overdue import LeftBehind
from gateway.state.entry_file import EntryFile, IsEntry
from gateway.state.memory import Memory
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
