"""The state that outlives the process: what the parts of a gateway find of earlier runs, and leave to the next one."""

from dataclasses import dataclass, field

from gateway.images.drivers.store import Store
from gateway.runtime.announced import AnnouncedDevices
from gateway.runtime.overdue import LeftBehind
from gateway.state.memory import Memory
from gateway.state.troubles import StateTroubles


@dataclass(frozen=True, kw_only=True)
class KeptState:
    """Where it is kept: in memory only, unless it is given something that writes to the state folder.

    `memory` is where devices have moved to, `left_behind` are late responses that may still arrive on ports of earlier
    lines, `announced` is what brokers keep. Persistent images need a `store`. `troubles` are those with the folder.
    """

    memory: Memory = field(default_factory=Memory)
    left_behind: LeftBehind = field(default_factory=LeftBehind)
    announced: AnnouncedDevices = field(default_factory=AnnouncedDevices)
    store: Store | None = None
    troubles: StateTroubles | None = None
