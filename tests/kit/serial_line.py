"""Real time and real descriptors for simulated devices: virtual serial ports that are served by a thread."""

import os
import select
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from typing import Self

from kit.device import SimulatedLine
from kit.pty import VirtualPort


class _Served(ABC):
    """A thread that looks after the far ends of virtual ports, as a context."""

    def __enter__(self) -> Self:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=type(self).__name__)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _serve(self) -> None:
        while not self._stop.is_set():
            with suppress(OSError, ValueError):  # a port is pulled out of our hands
                self._turn(0.01)

    @abstractmethod
    def _turn(self, timeout: float) -> None:
        """Do what there is to do, or wait so many seconds for it."""


class SerialDevices(_Served):
    """Simulated devices that answer on virtual ports."""

    def __init__(self, lines: Mapping[VirtualPort, SimulatedLine]) -> None:
        self._lines = lines
        self._due: list[tuple[float, VirtualPort, bytes]] = []

    def _turn(self, timeout: float) -> None:
        ports = {port.far_end: port for port in self._lines if port.is_plugged}
        for far_end in select.select(ports, [], [], timeout / 10)[0]:
            port, now = ports[far_end], time.monotonic()
            answers = self._lines[port].received(os.read(far_end, 512), now)
            self._due += [(now + delay, port, data) for delay, data in answers]
        now = time.monotonic()
        for _, port, data in [due for due in self._due if due[0] <= now]:
            port.write(data)
        self._due = [due for due in self._due if due[0] > now]


class Cable(_Served):
    """Two virtual ports joined: what one end writes, the other one reads."""

    def __init__(self, one: VirtualPort, other: VirtualPort) -> None:
        self._to = {one.far_end: other, other.far_end: one}

    def _turn(self, timeout: float) -> None:
        for far_end in select.select(self._to, [], [], timeout)[0]:
            self._to[far_end].write(os.read(far_end, 512))
