"""Two programs at a virtual port, one after the other: the second one never reads what was for the first.

    .venv/bin/python tests/soak/pty_clients.py --rounds 1000

The first one asks a slow device, or an image, and is killed (SIGKILL) at a random moment: before the gateway has read
its request, while the device thinks, or before it has read its response. The second one opens the port at a random
moment, perhaps before the kernel has cleared up the first one, and listens for a while: any byte before it has asked is
a fault. Then it asks, and must get what it asked for. If both have asked before the gateway could look, nobody knows
who has asked what: then it gets no response, and repeats its request, as any program does. In some rounds the gateway
stands still meanwhile (SIGSTOP).

Ends with status 0 if there was no fault, and the gateway has not more open in the end than in the beginning.
"""

import argparse
import os
import random
import re
import select
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.modbus.rtu import crc_fits, encode
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name    = "hall"
port    = "{hall}"
baud    = 115200
devices = [{{ unit = 1, name = "slow" }}]

[[line]]
name   = "old-hmi"
port   = "pty:ttyHMI"
baud   = 115200
role   = "server"
serves = "all"

[[image]]
unit = 200
holding = "0-199"
initial.holding = [{{ at = 0, values = [{values}] }}]
"""
#: What the device takes, in seconds.
THINKING: Final = 0.03
#: The longest that the first program lives after its request, and the second one listens before it asks.
LONGEST: Final = 0.06
#: How long the second one waits for a response, and how often it asks.
PATIENCE: Final = 1.5
ATTEMPTS: Final = 4
READABLE: Final = 100
UNITS: Final = (1, 200)


def value(unit: int, address: int) -> int:
    """What a register holds: nobody can take one for another."""
    return unit << 8 | address


class Judge:
    """Plays rounds at `link`, and counts what happens."""

    def __init__(self, link: Path, gateway: GatewayProcess, seed: int) -> None:
        self.counts = Counter[str]()
        self.faults: list[str] = []
        self._link = link
        self._gateway = gateway
        self._random = random.Random(seed)

    def play(self, number: int) -> None:
        """Play one round."""
        chance = self._random
        stands_still = chance.random() < 0.1
        first = self._start_first()
        if stands_still and chance.random() < 0.5:
            self._stand_still()
        time.sleep(chance.uniform(0, LONGEST) if chance.random() < 0.8 else 0)
        if stands_still:
            self._stand_still()
        os.kill(first, signal.SIGKILL)
        order = chance.choice(["at once", "once it is gone", "later"])
        if order != "at once":
            os.waitpid(first, 0)
        if order == "later":
            time.sleep(chance.uniform(0, 0.02))
        self.counts[order] += 1
        port = self._open()
        try:
            port = self._second(port, number, order)
        finally:
            with suppress(OSError):
                os.close(port)
        if order == "at once":
            os.waitpid(first, 0)

    def _start_first(self) -> int:
        """Fork the first program, and wait until it has asked, or sometimes not quite."""
        unit, start = self._random.choice(UNITS), self._random.randrange(READABLE)
        request, told = encode(unit, bytes((3, 0, start, 0, 7))), os.pipe()
        reads = self._random.random() < 0.3
        child = os.fork()
        if child == 0:
            port = os.open(self._link, os.O_RDWR | os.O_NOCTTY)
            os.write(port, request)
            os.write(told[1], b"!")
            while reads:
                os.read(port, 1)
            time.sleep(60)
            os._exit(1)
        os.close(told[1])
        os.read(told[0], 1)
        os.close(told[0])
        return child

    def _stand_still(self) -> None:
        self.counts["stood still"] += 1
        self._gateway.signal(signal.SIGSTOP)
        pause = self._random.uniform(0, 0.05)
        threading.Timer(pause, self._gateway.signal, (signal.SIGCONT,)).start()

    def _open(self) -> int:
        for _ in range(100):
            try:
                return os.open(self._link, os.O_RDWR | os.O_NOCTTY)
            except OSError as error:
                self.counts[f"not opened: {error.strerror}"] += 1
                time.sleep(0.001)
        raise AssertionError("the port cannot be opened")

    def _second(self, port: int, number: int, order: str) -> int:
        """Listen, ask, and compare. Return the descriptor, which may be another one after a hang-up."""
        if heard := self._listen(port, self._random.uniform(0, LONGEST) if self._random.random() < 0.7 else 0):
            self.faults.append(f"round {number}, opened {order}: {heard.hex(' ')} before it has asked")
        unit, start, count = self._random.choice(UNITS), self._random.randrange(READABLE), self._random.randint(1, 5)
        expected = b"".join(value(unit, start + at).to_bytes(2) for at in range(count))
        for attempt in range(ATTEMPTS):
            try:
                os.write(port, encode(unit, bytes((3, 0, start, 0, count))))
                response = self._response(port)
            except OSError:
                self.counts["hung up"] += 1
                os.close(port)
                port = self._open()
                continue
            if not response:
                self.counts["asked again"] += 1
                continue
            right = encode(unit, bytes((3, len(expected))) + expected)
            if response != right:
                self.faults.append(f"round {number}, opened {order}: {response.hex(' ')} instead of {right.hex(' ')}")
            self.counts[f"answered at attempt {attempt + 1}"] += 1
            return port
        self.faults.append(f"round {number}, opened {order}: no answer")
        return port

    def _listen(self, port: int, seconds: float) -> bytes:
        with suppress(OSError):
            if select.select([port], [], [], seconds)[0]:
                return os.read(port, 300)
        return b""

    def _response(self, port: int) -> bytes:
        data, until = b"", time.monotonic() + PATIENCE
        while (left := until - time.monotonic()) > 0 and not (len(data) > 4 and crc_fits(data)):
            if select.select([port], [], [], left)[0]:
                piece = os.read(port, 300)
                if not piece:
                    raise OSError
                data += piece
        return data


def open_files(gateway: GatewayProcess) -> Counter[str]:
    """What the gateway has open that belongs to virtual ports: kinds of files, and how many."""
    found = Counter[str]()
    for descriptor in Path(f"/proc/{gateway.pid}/fd").iterdir():
        with suppress(OSError):
            name = str(descriptor.readlink())
            if name.startswith("/dev/") or "inotify" in name:
                found[re.sub(r"\d+", "N", name)] += 1
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    args = parser.parse_args()
    with ExitStack() as parts:
        folder = Path(parts.enter_context(tempfile.TemporaryDirectory()))
        hall = parts.enter_context(VirtualPort(folder / "hall"))
        device = SimulatedDevice(1, delay=THINKING)
        device.holding = [value(1, address) for address in range(200)]
        parts.enter_context(SerialDevices({hall: SimulatedLine("rtu", device)}))
        values = ", ".join(str(value(200, address)) for address in range(200))
        config = CONFIG.format(hall=hall.path, values=values)
        gateway = parts.enter_context(GatewayProcess(folder, config))
        before = open_files(gateway)
        judge = Judge(folder / "ttyHMI", gateway, args.seed)
        for number in range(args.rounds):
            judge.play(number)
        time.sleep(1.0)
        left = open_files(gateway) - before
    print(f"seed {args.seed}: {args.rounds} rounds, {len(judge.faults)} faults; left open: {dict(left) or 'nothing'}")
    for what, count in sorted(judge.counts.items()):
        print(f"  {what}: {count}")
    for fault in judge.faults[:20]:
        print(f"  FAULT {fault}")
    return 1 if judge.faults or left else 0


if __name__ == "__main__":
    sys.exit(main())
