"""The clients' address of two gateways with one lease: keepalived moves it to whoever holds the lease.

    sudo apt install keepalived nats-server
    sudo .venv/bin/python tests/soak/keepalived.py

Two gateways on one bus, each with keepalived and the files of deploy/keepalived, are in network namespaces of their
own, with a bridge between them, at which NATS and the client are. The client asks the address that both share. Three
times the gateway that holds the lease is killed or stopped, and started again. Prints for how long the client had no
answer each time, and where the address was. Ends with status 0 if the other gateway answered at the address each time.
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Iterator

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[each]) for each in (1, 2)]

from gateway.modbus import mbap
from kit.process import COMMAND
from kit.programs import find
from kit.shared_bus import Bus

DEPLOYED = Path(__file__).resolve().parents[2] / "deploy" / "keepalived"
#: How long anything may take, in seconds.
PATIENCE = 60.0
ADDRESS = "10.77.0.10"
CONFIG = """
site = "plant-1"
[[listen]]
bind = "tcp://0.0.0.0:502"
[fleet]
servers = ["nats://10.77.0.1:4222"]
lease = "3 s"
[[line]]
name = "bus"
port = "{port}"
baud = 115200
timeout = "150 ms"
lease = "plant-1.hall-a"
[control]
socket = "{control}"
"""


def run(*words: object) -> None:
    subprocess.run([*map(str, words)], check=True)


class Machine:
    """A gateway with its keepalived, in a network namespace."""

    def __init__(self, folder: Path, number: int, port: Path) -> None:
        self.name = f"mbgw-{os.getpid()}-{number}"
        self._folder = folder / str(number)
        self._folder.mkdir()
        self._control = self._folder / "control.sock"
        (self._folder / "gateway.toml").write_text(CONFIG.format(port=port, control=self._control))
        self._write_scripts()
        text = (DEPLOYED / "keepalived.conf").read_text()
        for theirs, own in (
            ("/etc/keepalived/holds-lease", str(self._folder / "holds-lease")),
            ("10.2.0.12", f"10.77.0.{13 - number}"),
            ("10.2.0.10/24", f"{ADDRESS}/24"),
            ("priority 50", f"priority {60 - 10 * number}"),
        ):
            assert theirs in text, theirs
            text = text.replace(theirs, own)
        (self._folder / "keepalived.conf").write_text(text)
        self._number = number
        self._gateway: subprocess.Popen[bytes] | None = None

    def _write_scripts(self) -> None:
        """keepalived calls the script that is deployed, which calls `modbus-gateway`."""
        command = f'#!/bin/sh\nexec {sys.executable} -P -m gateway.cli.main "$@" --control {self._control}\n'
        environment = f"PYTHONPATH={os.environ['PYTHONPATH']} PATH={self._folder}:$PATH"
        call = f'#!/bin/sh\n{environment} exec {DEPLOYED}/holds-lease "$@"\n'
        for name, text in (("modbus-gateway", command), ("holds-lease", call)):
            (self._folder / name).write_text(text)
            (self._folder / name).chmod(0o755)

    @contextmanager
    def connected(self) -> "Iterator[Self]":
        """On the bridge, with both programs, in this context."""
        run("ip", "netns", "add", self.name)
        try:
            run("ip", "link", "add", f"port{self._number}", "type", "veth", "peer", "name", "eth0", "netns", self.name)
            run("ip", "link", "set", f"port{self._number}", "master", "bridge", "up")
            for words in (f"addr add 10.77.0.{10 + self._number}/24 dev eth0", "link set eth0 up", "link set lo up"):
                run("ip", "-n", self.name, *words.split())
            self.start()
            pids = [f"--{each}={self._folder}/{each}" for each in ("pid", "vrrp_pid", "checkers_pid")]
            keepalived = self._inside("keepalived", "-n", "-l", "-D", "-f", self._folder / "keepalived.conf", *pids)
            try:
                yield self
            finally:
                keepalived.terminate()
                keepalived.wait()
                self.end(signal.SIGKILL)
        finally:
            run("ip", "netns", "del", self.name)

    def start(self) -> None:
        self._gateway = self._inside(*COMMAND, "run", self._folder / "gateway.toml")

    def end(self, how: signal.Signals) -> None:
        gateway, self._gateway = self._gateway, None
        if gateway is not None:
            gateway.send_signal(how)
            gateway.wait()

    @property
    def has_address(self) -> bool:
        shown = subprocess.run(["ip", "-n", self.name, "addr"], check=True, capture_output=True, text=True).stdout
        return f" {ADDRESS}/" in shown

    def _inside(self, *words: object) -> "subprocess.Popen[bytes]":
        log = (self._folder / "log").open("ab")
        state = {"STATE_DIRECTORY": str(self._folder), "RUNTIME_DIRECTORY": str(self._folder)}
        command = ["ip", "netns", "exec", self.name, *map(str, words)]
        return subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | state)


def is_answered() -> bool:
    """Whether a client that connects to the shared address has its answer."""
    with suppress(OSError), socket.create_connection((ADDRESS, 502), timeout=0.5) as client:
        client.sendall(mbap.encode(1, 1, bytes((3, 0, 7, 0, 1))))
        return client.recv(260)[7:] == bytes((3, 2, 1, 7))
    return False


def wait_for_answers(machines: list[Machine]) -> Machine:
    """Whoever has the address when the client is answered; it must be one of them."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        having = [each for each in machines if each.has_address]
        if len(having) == 1 and is_answered():
            return having[0]
        time.sleep(0.02)
    raise SystemExit("the client is not answered")


def lose_holder(machines: list[Machine], holder: Machine, how: signal.Signals) -> Machine:
    """End the gateway that holds the lease, and wait until the other one answers: that one."""
    since = time.monotonic()
    holder.end(how)
    while is_answered():
        time.sleep(0.02)
    found = wait_for_answers([each for each in machines if each is not holder])
    gap = time.monotonic() - since
    print(f"{how.name} of the holder: the address is at {machines.index(found) + 1}, answers after {gap:.1f} s")
    assert not holder.has_address
    holder.start()
    return found


def soak(folder: Path) -> None:
    bus = Bus()
    with ExitStack() as stack:
        run("ip", "link", "set", "lo", "up")
        run("ip", "link", "add", "bridge", "type", "bridge")
        run("ip", "addr", "add", "10.77.0.1/24", "dev", "bridge")
        run("ip", "link", "set", "bridge", "up")
        server = [str(find("nats-server")), "-js", "-sd", folder / "nats", "-a", "10.77.0.1", "-l", folder / "nats.log"]
        nats = subprocess.Popen(server)
        stack.callback(nats.wait)
        stack.callback(nats.kill)
        machines = []
        for number in (1, 2):
            bus.terminal(str(number), folder / f"tty-{number}")
            machines.append(Machine(folder, number, folder / f"tty-{number}"))
        stack.enter_context(bus)
        for machine in machines:
            stack.enter_context(machine.connected())
        holder = wait_for_answers(machines)
        print(f"the address is at {machines.index(holder) + 1}")
        for how in (signal.SIGKILL, signal.SIGTERM, signal.SIGKILL):
            holder = lose_holder(machines, holder, how)
        print(f"{len(bus.collisions)} frames of two askers at once")


def main() -> int:
    if os.geteuid() != 0 or shutil.which("keepalived") is None or find("nats-server") is None:
        print("it needs root, keepalived and nats-server", file=sys.stderr)
        return 2
    if "ALONE" not in os.environ:  # with a network of its own, so that nothing of this machine's is touched
        environment = os.environ | {"ALONE": "1", "PYTHONPATH": os.pathsep.join(sys.path[:2])}
        os.execvpe("unshare", ["unshare", "--net", sys.executable, *sys.argv], environment)
    # keepalived runs no scripts from folders that others may change, such as /tmp
    with tempfile.TemporaryDirectory(dir="/run") as name:
        try:
            soak(Path(name))
        except BaseException:
            for log in Path(name).glob("*/log"):
                print(f"--- {log}", *log.read_text(errors="replace").splitlines()[-40:], sep="\n")
            raise
    return 0


if __name__ == "__main__":
    sys.exit(main())
