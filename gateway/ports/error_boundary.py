"""The error boundary around a part that has a port: its steps run here, and what goes wrong in them ends here."""

import asyncio
from collections.abc import Callable
from typing import Any

from gateway.events import Emit, PartFailed
from gateway.ports.alarm import Alarm
from gateway.ports.port import Port


class ErrorBoundary:
    """Runs the steps of one part, and its `tick` at its `deadline`, in seconds of the loop's clock.

    An error that nobody foresaw is told as one of `part`, `down` lets all requests of the part fail, and the port is
    closed: its keeper opens it again. No such error reaches another part.
    """

    def __init__(
        self,
        part: str,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        *,
        deadline: Callable[[], float | None],
        tick: Callable[[], None],
        down: Callable[[], None],
    ) -> None:
        self.port: Port | None = None
        self._part = part
        self._emit = emit
        self._deadline = deadline
        self._tick = tick
        self._down = down
        self._alarm = Alarm(loop, self.wake)

    def run(self, step: Callable[..., None], *arguments: Any) -> None:
        """Take one step."""
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - a defect in one part must not reach the others
            self._tell(error)
            self.hang_up()
        self.plan()

    def plan(self) -> None:
        """The part's deadline may have changed: its next step is planned, and none is taken before this returns."""
        self._alarm.set(self._deadline())

    def wake(self) -> None:
        """Let time pass."""
        self.run(self._tick)

    def lost(self) -> None:
        """The port has gone."""
        self.port = None
        self.run(self._down)

    def hang_up(self) -> None:
        """Do without the port from now on, and close it."""
        port, self.port = self.port, None
        try:
            self._down()
        except Exception as error:  # noqa: BLE001 - see run
            self._tell(error)
        finally:
            if port is not None:
                port.close()

    def overdue(self, now: float) -> float:
        """For how many seconds something should have been done, and was not."""
        deadline = self._deadline()
        return 0.0 if deadline is None else max(0.0, now - deadline)

    def close(self) -> None:
        """Wake no more."""
        self._alarm.close()

    def _tell(self, error: Exception) -> None:
        self._emit(PartFailed.of(self._part, error))
