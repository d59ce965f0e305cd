"""An adapter that is pulled and returned again and again while clients ask: nobody hangs, nothing leaks.

    .venv/bin/python tests/soak/pull.py --cycles 1000

Ends with status 0 if every request was answered, within the promised times, and no descriptor was left open.
"""

import argparse
import socket
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.device import SimulatedDevice, SimulatedLine
from kit.process import GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

#: What is promised, in seconds: an answer after a loss, and service after a return.
ANSWERED_WITHIN = 0.250
BACK_WITHIN = 2.0
#: A request that has no answer by then never gets one.
PATIENCE = 10.0

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{port}"
timeout = "50 ms"   # what was asked when the adapter went may still be answered for twice as long
"""
READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
RIGHT = bytes.fromhex("0001 0000 0005 01 03 02 002A")


@dataclass
class Tally:
    """What the client saw; times in seconds."""

    answers: dict[str, int] = field(default_factory=dict)
    slowest: float = 0.0
    wrong: list[str] = field(default_factory=list)
    last_right: float = 0.0


def poll(port: int, stop: threading.Event, tally: Tally) -> None:
    """Ask again and again; every answer must be the value or 0A or 0B."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as client:
        while not stop.is_set():
            begin = time.monotonic()
            client.sendall(READ)
            answer = client.recv(260)
            now = time.monotonic()
            tally.slowest = max(tally.slowest, now - begin)
            kind = "right" if answer == RIGHT else f"exception {answer[8]:02X}" if answer[7] == 0x83 else "wrong"
            tally.answers[kind] = tally.answers.get(kind, 0) + 1
            if kind == "right":
                tally.last_right = now
            elif kind == "wrong":
                tally.wrong.append(answer.hex(" "))
            time.sleep(0.002)


def pull_and_return(port: VirtualPort, tally: Tally) -> float:
    """One cycle; how long after the return the first right answer came.

    Raises:
        TimeoutError: none came.
    """
    time.sleep(0.02)
    port.unplug()
    time.sleep(0.02)
    port.plug()
    returned = time.monotonic()
    while tally.last_right < returned:
        if time.monotonic() - returned > PATIENCE:
            raise TimeoutError(f"no right answer within {PATIENCE:g} s of the return; so far {tally}")
        time.sleep(0.005)
    return tally.last_right - returned


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=1000)
    cycles = parser.parse_args().cycles
    device = SimulatedDevice(1, delay=0.002)
    device.holding[0] = 42
    tally, stop = Tally(), threading.Event()
    with ExitStack() as running:
        folder = Path(running.enter_context(tempfile.TemporaryDirectory()))
        port = running.enter_context(VirtualPort(folder / "hall-a"))
        running.enter_context(SerialDevices({port: SimulatedLine("rtu", device)}))
        gateway = running.enter_context(GatewayProcess(folder, CONFIG.format(port=port.path)))
        client = threading.Thread(target=poll, args=(gateway.port, stop, tally))
        client.start()
        running.callback(client.join)
        running.callback(stop.set)
        times = [pull_and_return(port, tally) for _ in range(5)]
        before = gateway.descriptors
        for cycle in range(cycles):
            times.append(pull_and_return(port, tally))
            if cycle % 100 == 99:
                print(f"{cycle + 1} cycles, {gateway.descriptors} descriptors, {tally.answers}", flush=True)
        leaked = gateway.descriptors - before
    print(
        f"{cycles} cycles: {tally.answers}; slowest answer {1000 * tally.slowest:.0f} ms,"
        f" slowest return {1000 * max(times):.0f} ms, {leaked} descriptors leaked, {len(tally.wrong)} wrong answers"
    )
    kept = tally.slowest <= ANSWERED_WITHIN and max(times) <= BACK_WITHIN and leaked <= 0 and not tally.wrong
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
