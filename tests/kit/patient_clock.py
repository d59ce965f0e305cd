"""A clock for limits in real time, on a machine that may be busy."""

import threading
import time
from typing import Final, Self

_TICK: Final = 0.01


class PatientClock:
    """In its context it counts the `seconds` in which this machine had time for this process.

    On a quiet machine these are seconds. Who only sleeps is as late on a busy one as what is measured, and the time by
    which it was late is not counted.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._is_over = False
        self._thread = threading.Thread(target=self._run, name="patient clock")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join()

    def _run(self) -> None:
        while not self._is_over:
            time.sleep(_TICK)
            self.seconds += _TICK
