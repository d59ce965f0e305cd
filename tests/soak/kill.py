"""Kill the gateway in the middle of writes, again and again: no acknowledged write may be lost.

    .venv/bin/python tests/soak/kill.py --rounds 500

Each round starts a gateway with an image that is kept `always`, reads what the last round left, and writes with several
clients, each to a register of its own. Meanwhile a reload puts an image of another size in the place of that one. Then
kill -9, at any moment. A register may hold the last acknowledged value, or the one that was under way; anything else is
a loss, at the next start as well as right after the write. Persisted writes are timed beside plain ones.
"""

import argparse
import os
import random
import signal
import socket
import statistics
import sys
import tempfile
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from gateway.modbus import mbap
from kit.process import GatewayProcess

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit    = 200
holding = 100
persist = "always"

[[image]]
unit    = 201
holding = 100
"""
CLIENTS = 4
KEPT, PLAIN = 200, 201
#: Longest time from the first write to the kill, in seconds.
LONGEST_ROUND = 0.3


class Client:
    """One connection. `times` are those of its answered writes to each unit, in seconds."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self.times: dict[int, list[float]] = {KEPT: [], PLAIN: []}

    def ask(self, unit: int, pdu: bytes) -> bytes:
        """The response PDU; empty when the gateway has gone."""
        try:
            self._socket.sendall(mbap.encode(1, unit, pdu))
            return self._socket.recv(260)[7:]
        except ConnectionError:
            return b""

    def write(self, unit: int, register: int, value: int) -> bool:
        """Whether the write was acknowledged."""
        begin = time.perf_counter()
        pdu = bytes((6, 0, register, *value.to_bytes(2, "big")))
        acknowledged = self.ask(unit, pdu) == pdu
        if acknowledged:
            self.times[unit].append(time.perf_counter() - begin)
        return acknowledged

    def read(self, register: int) -> int | None:
        """The value of a register of the kept image; None when the gateway has gone."""
        response = self.ask(KEPT, bytes((3, 0, register, 0, 1)))
        return int.from_bytes(response[2:], "big") if response else None

    def close(self) -> None:
        self._socket.close()


class Writer:
    """Writes 1, 2, 3, ... to one register; `sent` is the last value, `acknowledged` the last one with an answer."""

    def __init__(self, register: int) -> None:
        self.register = register
        self.acknowledged = self.sent = self.lost = 0
        self.times: dict[int, list[float]] = {KEPT: [], PLAIN: []}

    def check(self, client: Client) -> None:
        """Look whether the register holds one of both values, unless the gateway has gone."""
        found = client.read(self.register)
        if found is None:
            return
        if found not in (self.acknowledged, self.sent):
            self.lost += 1
            print(f"register {self.register}: {found} found, {self.acknowledged} acknowledged, {self.sent} sent")
        self.acknowledged = self.sent = found

    def run(self, port: int) -> None:
        """Write until the gateway has gone."""
        with suppress(OSError), closing(Client(port)) as client:
            while True:
                self.sent = (self.sent + 1) % 0x10000
                if not client.write(KEPT, self.register, self.sent):
                    break
                self.acknowledged = self.sent
                self.check(client)
                client.write(PLAIN, self.register, self.sent)
            for unit, times in client.times.items():
                self.times[unit] += times


def kill_often(writers: list[Writer], rounds: int, seed: int, folder: Path) -> None:
    """Let the writers write until the kill, round by round, and check what the last round left."""
    choose = random.Random(seed)
    for _ in range(rounds):
        with GatewayProcess(folder, CONFIG) as gateway:
            with closing(Client(gateway.port)) as client:
                for writer in writers:
                    writer.check(client)
            threads = [threading.Thread(target=writer.run, args=(gateway.port,)) for writer in writers]
            for thread in threads:
                thread.start()
            reload_at, kill_at = sorted(choose.uniform(0, LONGEST_ROUND) for _ in range(2))
            time.sleep(reload_at)
            resize(gateway, choose.randint(CLIENTS, 99))
            time.sleep(kill_at - reload_at)
            gateway.signal(signal.SIGKILL)
            for thread in threads:
                thread.join()


def resize(gateway: GatewayProcess, holding: int) -> None:
    """Give the kept image so many registers."""
    gateway.config.write_text(gateway.config.read_text().replace("holding = 100", f"holding = {holding}", 1))
    gateway.signal(signal.SIGHUP)


def show_times(name: str, times: list[float]) -> None:
    percentiles = statistics.quantiles(times, n=100)
    p50, p99 = 1000 * percentiles[49], 1000 * percentiles[98]
    print(f"{name}: {len(times)} answered, p50 {p50:.2f} ms, p99 {p99:.2f} ms, longest {1000 * max(times):.1f} ms")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    writers = [Writer(register) for register in range(CLIENTS)]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["STATE_DIRECTORY"] = folder
        kill_often(writers, arguments.rounds + 1, arguments.seed, Path(folder))  # one more to see the last
    lost = sum(writer.lost for writer in writers)
    for name, unit in (("persisted writes", KEPT), ("plain writes", PLAIN)):
        show_times(name, [one for writer in writers for one in writer.times[unit]])
    print(f"{arguments.rounds} rounds, {lost} acknowledged writes lost")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
