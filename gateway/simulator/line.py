"""A simulated line for programs: devices behind a virtual serial port, in an event loop.

    async with SimulatedLine("/tmp/hall-a", [Weigher(1), Weigher(2, moves=True)]):
        ...  # /tmp/hall-a can be opened as a serial port

It uses callbacks and one timer, and no task.
"""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Self

from gateway.clock.lazy_timer import LazyTimer
from gateway.config.values.port import DEFAULT_FORMATS
from gateway.simulator.device import Device, Mode
from gateway.simulator.faults import NO_LINE_FAULTS, LineFaults
from gateway.simulator.paced_line import PacedLine, Tell, ignore_frame
from gateway.simulator.port import VirtualPort
from gateway.timing.characters import CharacterFormat


class SimulatedLine:
    """`devices` behind a serial port at `path`, which exists inside the context.

    `format_` decides how many bits a character takes (default 8E1 for RTU, 7E1 for ASCII); on a pseudo-terminal the
    kernel always carries eight bits without parity. `seed` is for the noise. `tell` is called with each frame.
    `faults` are faults of the line itself.

    Raises:
        PortError: on entering, if the port cannot be created at `path`.
        ValueError: a device does not have the mode.
    """

    def __init__(
        self,
        path: Path | str,
        devices: Sequence[Device],
        *,
        mode: Mode = "rtu",
        format_: CharacterFormat | None = None,
        seed: int = 0,
        tell: Tell = ignore_frame,
        faults: LineFaults = NO_LINE_FAULTS,
    ) -> None:
        for device in devices:
            if mode not in device.modes:
                kind = device.profile.name
                raise ValueError(f"a {kind} does not speak {mode}, and all devices of a line speak the same")
        self.path = Path(path)
        self.devices = tuple(devices)
        self._line = PacedLine(mode, format_ or DEFAULT_FORMATS[mode], devices, seed=seed, tell=tell, faults=faults)

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self._port = VirtualPort(self.path)
        self._timer = LazyTimer(self._loop, self._wake)
        self._loop.add_reader(self._port, self._readable)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._loop.remove_reader(self._port)
        self._timer.close()
        self._port.close()

    def _readable(self) -> None:
        """Send what the gateway has written, at the rate that is set now."""
        data, now = self._port.read(), self._loop.time()
        self._let_pass(now)
        self._line.written(data, now, self._port.baud)
        self._timer.set(self._line.deadline())

    def _wake(self) -> None:
        self._let_pass(self._loop.time())
        self._timer.set(self._line.deadline())

    def _let_pass(self, now: float) -> None:
        data = self._line.tick(now)
        if data:
            self._port.write(data)
