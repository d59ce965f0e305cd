"""Bad clients beside a good one: it must hardly notice them.

    .venv/bin/python tests/soak/clients.py

A healthy client's p99 is taken undisturbed, then beside 500 half-open connections that never finish a request, a flood
of malformed requests, and a reader that asks and never reads. Ends with status 0 if it stays within 1.5 times its own.
"""

import argparse
import asyncio
import contextlib
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.device import SimulatedDevice, SimulatedLine
from kit.process import GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

#: What is promised: how much slower a healthy client's slowest hundredth may become.
PROMISED = 1.5

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"
clients = 600

[[line]]
name = "hall-a"
port = "{port}"

[[image]]
unit = 200
holding = 125
"""
READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
IMAGE_READ = bytes.fromhex("0001 0000 0006 C8 03 0000 007D")
#: A quantity of 0: answered 03.
MALFORMED = bytes.fromhex("0001 0000 0006 01 03 0000 0000")


async def healthy(port: int, seconds: float) -> list[float]:
    """Ask one thing after the other; how long each answer took, in seconds."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    times = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        begin = time.monotonic()
        writer.write(READ)
        answer = await asyncio.wait_for(reader.readexactly(11), 10)
        times.append(time.monotonic() - begin)
        if answer[7] != 3:
            raise AssertionError(f"not the answer: {answer.hex(' ')}")
        await asyncio.sleep(0.01)
    writer.close()
    return times


async def half_open(port: int) -> None:
    """500 connections that send six bytes of a header, and come again when they are closed."""

    async def one() -> None:
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(READ[:6])
                await reader.read()
                writer.close()

    await asyncio.gather(*(one() for _ in range(500)))


async def malformed(port: int) -> None:
    """100 malformed requests a second."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    while True:
        writer.write(MALFORMED)
        await reader.readexactly(9)
        await asyncio.sleep(0.01)


async def slow_reader(port: int) -> None:
    """Asks for the largest answers as long as they are taken, and reads none."""
    while True:
        _, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.transport.pause_reading()
        with contextlib.suppress(OSError):
            while True:
                writer.write(IMAGE_READ * 16)
                await writer.drain()
                await asyncio.sleep(0.001)


async def measure(port: int, seconds: float, *nuisances: Callable[[int], Coroutine[None, None, None]]) -> float:
    """The healthy client's p99 in milliseconds, beside these."""
    tasks = [asyncio.create_task(nuisance(port)) for nuisance in nuisances]
    await asyncio.sleep(2 if tasks else 0)
    times = await healthy(port, seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return 1000 * statistics.quantiles(times, n=100)[98]


async def run(port: int, seconds: float) -> bool:
    """Undisturbed and disturbed in turn, because machines have moods; the medians are compared."""
    calm, beset = [], []
    for _ in range(3):
        calm.append(await measure(port, seconds))
        beset.append(await measure(port, seconds, half_open, malformed, slow_reader))
        print(f"p99 undisturbed {calm[-1]:.2f} ms, beside bad clients {beset[-1]:.2f} ms", flush=True)
    ratio = statistics.median(beset) / statistics.median(calm)
    print(f"ratio of the medians {ratio:.2f}, promised at most {PROMISED}")
    return ratio <= PROMISED


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (
            VirtualPort(folder / "hall-a") as port,
            SerialDevices({port: SimulatedLine("rtu", SimulatedDevice(1, delay=0.002))}),
            GatewayProcess(folder, CONFIG.format(port=port.path)) as gateway,
        ):
            kept = asyncio.run(run(gateway.port, seconds))
            tracebacks = [event for event in gateway.log if "traceback" in event]
    print(*tracebacks[:3], sep="\n")
    return 0 if kept and not tracebacks else 1


if __name__ == "__main__":
    sys.exit(main())
