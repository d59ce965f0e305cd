"""A system that is booted in a container of systemd-nspawn, with the gateway of this checkout and its units installed.

It needs root, systemd-nspawn and the folder that kit/system_tree.py makes, and leaves nothing behind.
"""

import ctypes
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from fcntl import ioctl
from pathlib import Path
from struct import Struct
from typing import Any

import gateway
from kit.process import PATIENCE
from kit.system_tree import PYTHON, system_tree

UNITS = Path(__file__).parents[2] / "systemd"
SERVICE = "modbus-gateway.service"
SOCKET = "modbus-gateway.socket"

_CODE = "/opt/modbus-gateway"
_LIBRARIES = "/opt/libraries"
#: Where what was compiled of both is kept. Without it each start would compile all of it again: nobody may write there.
_BYTECODE = "/opt/bytecode"
#: The same here, for the next system.
_KEPT_BYTECODE = Path(sys.prefix, "booted-bytecode")
#: A line, and an address that no machine has.
_ELSEWHERE = """
[[listen]]
bind = "tcp://192.0.2.1:502"

[[line]]
port = "/dev/nowhere"
devices = [{ unit = 1 }]
"""
#: What the Debian package starts, and where it looks there.
_LAUNCHER = Path(__file__).parents[2] / "deploy/debian/launcher/modbus-gateway"
_PACKAGED = 'sys.path.insert(0, "/usr/lib/modbus-gateway")'
#: Goes into control groups and then runs a command, which ends when we do: GROUP... -- COMMAND.
_JOIN = """
set -e
while [ "$1" != -- ]; do echo $$ > "$1/cgroup.procs"; shift; done
shift
exec setpriv --pdeathsig TERM "$@"
"""
#: What makes units of other files takes half of each daemon-reload, and there are no such files: systemd.generator(7).
_MASK_GENERATORS = """
mkdir /run/systemd/system-generators
for generator in /usr/lib/systemd/system-generators/*; do
    ln -s /dev/null "/run/systemd/system-generators/${generator##*/}"
done
"""
#: Where control groups are mounted, by their name in /proc/PID/cgroup; the first of them that is there.
_HIERARCHIES = {"": ("unified", ""), "name=systemd": ("systemd",)}
_CLONE_NEWNET = 0x40000000
_SIOCSIFADDR = 0x8916
_IFREQ = Struct("16sHH4s16x")


def why_not() -> str:
    """What is missing to boot a system here; empty if nothing is."""
    if os.geteuid() != 0:
        return "systemd-nspawn needs root"
    if shutil.which("systemd-nspawn") is None:
        return "systemd-nspawn is not installed (Debian package systemd-container)"
    if not system_tree().exists():
        return "there is no system to boot (python3 tests/kit/system_tree.py makes it; Debian package mmdebstrap)"
    if sys.version_info[:2] != PYTHON:
        return f"that system has Python {PYTHON[0]}.{PYTHON[1]}, and .venv another one"
    return ""


class CannotBootError(Exception):
    """This machine lets nobody boot a system in a container; the text is what systemd-nspawn says."""


class BootedSystem:
    """A system that runs. `leader` is its first process as this machine sees it, `root` its file system."""

    def __init__(self, leader: int) -> None:
        self.leader = leader
        self.root = Path(f"/proc/{leader}/root")
        self._since = 0.0
        self._is_overridden = False

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command in it, as root."""
        inside = ["nsenter", "--target", str(self.leader), "--all", *words]
        return subprocess.run(inside, capture_output=True, text=True, timeout=PATIENCE, check=False)

    def done(self, *words: str) -> str:
        """What a command prints that has to succeed."""
        ran = self.run(*words)
        assert ran.returncode == 0, f"{words}: {ran.stdout}{ran.stderr}{self.status()}"
        return ran.stdout

    def write(self, path: str, text: str) -> None:
        """Write a file, and the folders on the way to it."""
        file = self.root / path.lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    def override(self, unit: str, text: str) -> None:
        """What `systemctl edit` does."""
        self._is_overridden = True
        self.write(f"/run/systemd/system/{unit}.d/test.conf", text)
        self.done("systemctl", "daemon-reload")

    def end_overrides(self) -> None:
        """Have all units as they are installed again."""
        if self._is_overridden:
            self.done("sh", "-c", "rm -r /run/systemd/system/modbus-gateway.*; systemctl daemon-reload")
            self._is_overridden = False

    def show(self, name: str, unit: str = SERVICE) -> str:
        """A property of a unit."""
        return self.done("systemctl", "show", "--value", f"--property={name}", unit).strip()

    def status(self) -> str:
        """How the service is, for people."""
        return self.run("systemctl", "status", "--no-pager", "--full", "--lines=50", SERVICE).stdout

    def connect(self, host: str = "127.0.0.1", port: int = 502) -> socket.socket:
        """A client's connection from inside."""
        client = self.open_socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        client.connect((host, port))
        return client

    def open_socket(self, family: int = socket.AF_INET, kind: int = socket.SOCK_STREAM) -> socket.socket:
        """A socket on its network."""

        def made() -> socket.socket:
            with Path(f"/proc/{self.leader}/ns/net").open() as network:
                if ctypes.CDLL(None, use_errno=True).setns(network.fileno(), _CLONE_NEWNET):
                    raise OSError(ctypes.get_errno(), "setns")
            return socket.socket(family, kind)

        with ThreadPoolExecutor(1) as thread:  # only the thread enters that network, and ends
            inside = thread.submit(made).result()
        inside.settimeout(PATIENCE)
        return inside

    def add_address(self, address: str) -> None:
        """Give it another IPv4 address on its network: netdevice(7)."""
        with self.open_socket() as inside:
            ioctl(inside, _SIOCSIFADDR, _IFREQ.pack(b"lo:1", socket.AF_INET, 0, socket.inet_aton(address)))

    def log(self, *matches: str) -> list[dict[str, Any]]:
        """The journal's entries about the service since `forget_log`; those with `MODBUS_UNIT=46`."""
        words = ["journalctl", "--output=json", f"--since=@{self._since:.6f}"]
        entries = self.done(*words, *(matches or ["--unit", SERVICE]))
        return [json.loads(entry) for entry in entries.splitlines()]

    def forget_log(self) -> None:
        """From here on."""
        self._since = time.time()

    def wait_for(self, event: str) -> dict[str, Any]:
        """The first event of this name in the log."""
        until(lambda: self.log(f"MODBUS_EVENT={event}"), lambda: f"no {event}: {self.status()}")
        return self.log(f"MODBUS_EVENT={event}")[0]


def until(is_so: Callable[[], object], otherwise: Callable[[], str]) -> None:
    """Wait until it is so."""
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end, otherwise()
        time.sleep(0.2)  # each look starts some processes


@contextmanager
def booted(folder: Path) -> Iterator[BootedSystem]:
    """A system with the gateway of this checkout and its units; otherwise see `booted_bare`."""
    with booted_bare(folder, system_tree()) as system:
        yield _installed(system)


@contextmanager
def booted_bare(folder: Path, tree: Path) -> Iterator[BootedSystem]:
    """A system of its own, on a network of its own; /dev/pts of this machine is its /dev/hostpts.

    Raises:
        CannotBootError: this machine does not allow it.
    """
    _KEPT_BYTECODE.mkdir(exist_ok=True)
    with _control_groups() as groups, (folder / "console").open("w+") as console:
        nspawn = subprocess.Popen(
            ["sh", "-c", _JOIN, "sh", *map(str, groups), "--", *_nspawn(tree)],
            stdin=subprocess.DEVNULL,
            stdout=console,
            stderr=subprocess.STDOUT,
            env={**os.environ, "SYSTEMD_NSPAWN_UNIFIED_HIERARCHY": "1"},
            start_new_session=True,  # killed together with us, it would leave the system running
        )
        try:
            yield _started(nspawn, console.name)
        finally:
            _end(nspawn)


def _nspawn(tree: Path) -> list[str]:
    return [
        "systemd-nspawn",
        "--quiet",
        f"--directory={tree}",
        "--volatile=overlay",
        "--boot",
        "--register=no",
        "--keep-unit",
        "--console=pipe",
        "--link-journal=no",
        "--private-network",
        # Without these two DeviceAllow= has no effect.
        "--capability=all",
        "--system-call-filter=bpf",
        "--bind=/dev/pts:/dev/hostpts",
        f"--bind-ro={Path(gateway.__file__).parent}:{_CODE}/gateway",
        f"--bind-ro={sysconfig.get_path('purelib')}:{_LIBRARIES}",
        f"--bind={_KEPT_BYTECODE}:{_BYTECODE}",
    ]


def _end(nspawn: subprocess.Popen[bytes]) -> None:
    """End its first process, and so all others: a shutdown takes two seconds of a processor."""
    for leader in _leader(nspawn):
        os.kill(int(leader), signal.SIGKILL)
    nspawn.terminate()  # if there is no such process yet
    try:
        nspawn.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        nspawn.kill()
        nspawn.wait()


def _leader(nspawn: subprocess.Popen[bytes]) -> list[str]:
    """The number of the system's first process, if there is one."""
    try:
        return Path(f"/proc/{nspawn.pid}/task/{nspawn.pid}/children").read_text().split()
    except OSError:  # nspawn has ended
        return []


def _started(nspawn: subprocess.Popen[bytes], console: str) -> BootedSystem:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if nspawn.poll() is not None:
            raise CannotBootError(Path(console).read_text().strip())
        if leader := _leader(nspawn):
            system = BootedSystem(int(leader[0]))
            if system.run("systemctl", "is-system-running", "--wait").stdout.strip() in {"running", "degraded"}:
                return system
        time.sleep(0.05)
    raise AssertionError(f"the system does not come up: {Path(console).read_text()}")


def _installed(system: BootedSystem) -> BootedSystem:
    launcher = _LAUNCHER.read_text()
    assert _PACKAGED in launcher
    here = f"sys.pycache_prefix = {_BYTECODE!r}; sys.path[:0] = {[_CODE, _LIBRARIES]}"
    system.write("/usr/bin/modbus-gateway", launcher.replace(_PACKAGED, here))
    (system.root / "usr/bin/modbus-gateway").chmod(0o755)
    for unit in UNITS.iterdir():
        system.write(f"/etc/systemd/system/{unit.name}", unit.read_text())
    system.done("sh", "-c", _MASK_GENERATORS)
    system.done("systemctl", "daemon-reload")
    _compile(system)
    return system


def _compile(system: BootedSystem) -> None:
    """Start it as root, who may write what was compiled, with a config with which it ends once it has imported all."""
    system.write("/tmp/elsewhere.toml", _ELSEWHERE)
    ran = system.run("modbus-gateway", "run", "/tmp/elsewhere.toml")
    assert ran.stderr.endswith("this machine has no such address\n"), ran


@contextmanager
def _control_groups() -> Iterator[list[Path]]:
    """Control groups of the system's own: it may not meet another one, or those of this machine."""
    groups = [group / f"gateway-test-{os.getpid()}" for group in _our_groups()]
    try:
        try:
            for group in groups:
                group.mkdir()
        except OSError as error:
            raise CannotBootError(str(error)) from error
        yield groups
    finally:
        for group in groups:
            _remove(group)


def _our_groups() -> Iterator[Path]:
    for line in Path("/proc/self/cgroup").read_text().splitlines():
        _, hierarchy, path = line.split(":", 2)
        places = (Path("/sys/fs/cgroup", place) for place in _HIERARCHIES.get(hierarchy, ()))
        yield from [place / path.strip("/") for place in places if place.is_dir()][:1]


def _remove(group: Path) -> None:
    for folder, _, _ in os.walk(group, topdown=False):
        with suppress(OSError):
            Path(folder).rmdir()
