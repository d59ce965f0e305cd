"""Records of ports in the trace: when one was opened or lost."""

from collections.abc import Callable

from gateway.events import Emit, Event, LineLost, LineReopened, LineUp
from gateway.trace.ring import Ring


def kept_in(ring: Ring, clock: Callable[[], float], emit: Emit) -> Emit:
    """Make a function that emits events with `emit`, and records in `ring` when a port was opened or lost."""

    def tell(event: Event) -> None:
        if isinstance(event, LineLost):
            ring.add_port(event.line, clock(), event.reason)
        elif isinstance(event, LineUp | LineReopened):
            ring.add_port(event.line, clock())
        emit(event)

    return tell
