"""The state that outlives the process: what the parts of a gateway find of earlier runs, and leave to the next one."""

from collections.abc import Callable
from dataclasses import dataclass, field

from gateway.images.drivers.store import Store
from gateway.runtime.overdue import LeftBehind
from gateway.state.entry_file import EntryFile, IsEntry
from gateway.state.memory import Memory
from gateway.state.troubles import StateTroubles


def _open_nothing(_name: str, _is_entry: IsEntry) -> None:
    """Keep nothing."""


@dataclass(frozen=True, kw_only=True)
class KeptState:
    """Where it is kept: in memory only, unless it is given something that writes to the state folder.

    `memory` is where devices have moved to, `left_behind` are late responses that may still arrive on ports of earlier
    lines. Persistent images need a `store`. `troubles` are those with the folder. An add-on opens a file of its own by
    its name with `open_file`; it is None without a folder.
    """

    memory: Memory = field(default_factory=Memory)
    left_behind: LeftBehind = field(default_factory=LeftBehind)
    open_file: Callable[[str, IsEntry], EntryFile | None] = _open_nothing
    store: Store | None = None
    troubles: StateTroubles | None = None
