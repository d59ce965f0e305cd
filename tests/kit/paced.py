"""Simulated devices at the pace of a real line, on a line in memory and in virtual time."""

import asyncio

from gateway.simulator.device import Device
from gateway.simulator.paced_line import PacedLine
from gateway.timing.characters import CharacterFormat
from kit.memory import MemoryLine


def attach_paced(line: MemoryLine, mode: str, baud: int, *devices: Device) -> None:
    """Let `devices` answer on `line`, each character in its time."""
    loop = asyncio.get_running_loop()
    paced = PacedLine(mode, CharacterFormat(8 if mode == "rtu" else 7, "E", 1), devices)

    def wake() -> None:
        data = paced.tick(loop.time())
        if data:
            line.deliver(data)
        wait()

    def wait() -> None:
        at = paced.deadline()
        if at is not None:
            loop.call_at(at, wake)

    def written(data: bytes) -> None:
        paced.tick(loop.time())
        paced.written(data, loop.time(), baud)
        wait()

    line.on_write = written
