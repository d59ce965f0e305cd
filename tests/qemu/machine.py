"""Machines of qemu, with a kernel of Debian and a file system in memory, for what needs a driver of the kernel.

All of it needs root and `apt install mmdebstrap cpio qemu-system-x86 qemu-system-arm`. A Debian of half a gigabyte is
unpacked the first time, and kept in `~/.cache`; none of its programs runs on this machine.
"""

import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final, NamedTuple, NoReturn, Self

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit.system_tree import make, system_tree
from qemu.gateway_guest import TURNAROUND

#: How long a machine may say nothing, in seconds.
PATIENCE: Final = 900
CHECKOUT: Final = Path(__file__).resolve().parents[2]
#: What every machine needs of the Debian. Its kernel has the drivers of UARTs built in.
TREE: Final = (
    "usr/bin/python3*",
    "usr/lib/python3*",
    "usr/lib/*-linux-gnu*",
    "lib/*-linux-gnu*",
    "lib/ld-*",
    "lib64",
    "bin/busybox",
)
#: The first process of a machine begins with this.
MOUNT: Final = """\
#!/bin/busybox sh
busybox mount -t proc proc /proc
busybox mount -t sysfs sys /sys
busybox mount -t devtmpfs dev /dev
busybox mkdir -p /dev/pts
busybox mount -t devpts pts /dev/pts
export PYTHONDONTWRITEBYTECODE=1 PATH=/usr/bin:/bin:/usr/sbin:/sbin
"""
OFF: Final = "busybox poweroff -f\n"


class Machine(NamedTuple):
    """A kind of machine, by Debian's name, and how qemu is called for it. Its console is the chardev `console`."""

    architecture: str
    program: tuple[str, ...]


PC: Final = Machine("amd64", ("qemu-system-x86_64", "-serial", "chardev:console"))
ARM: Final = Machine(
    "arm64",
    ("qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a57", "-serial", "chardev:line",
     "-device", "pci-serial,chardev=console"),
)  # fmt: skip


def debian_for(machine: Machine, *packages: str) -> Path:
    """Its Debian, only unpacked, so that it may be of another architecture than this machine."""
    named = ("python3-minimal", "libpython3-stdlib", "busybox-static", *packages)
    command = (
        *("mmdebstrap", "--quiet", "--variant=extract", f"--architectures={machine.architecture}"),
        f"--include=linux-image-{machine.architecture},{','.join(named)}",
    )
    make(command=command)
    return system_tree(command=command)


def pack(debian: Path, init: str, files: Mapping[str, Path], folder: Path, more: Iterable[str] = ()) -> Path:
    """The machine's file system, in a file that the kernel unpacks: the Debian, and `files` by their place in it."""
    root = folder / "root"
    for mount in ("proc", "sys", "dev", "tmp", "run", "etc"):
        (root / mount).mkdir(parents=True)
    for merged in ("bin", "sbin", "lib", "lib64"):
        (root / "usr" / merged).mkdir(parents=True)
        (root / merged).symlink_to(f"usr/{merged}")
    for pattern in (*TREE, *more):
        for source in debian.glob(pattern):
            _copy(source, root / source.relative_to(debian))
    for place, source in files.items():
        _copy(source, root / place)
    _compile(root)
    (root / "init").write_text(MOUNT + init + OFF)
    (root / "init").chmod(0o755)
    packed = folder / "initrd"
    with packed.open("wb") as file:
        subprocess.run("find . | cpio --quiet -o -H newc", shell=True, cwd=root, stdout=file, check=True)
    shutil.rmtree(root)
    return packed


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir() and not source.is_symlink():
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(source, target, symlinks=True, dirs_exist_ok=True, ignore=ignored)
    else:
        shutil.copy(source, target, follow_symlinks=False)


def _compile(root: Path) -> None:
    """Add byte code, as the package does at its installation: an emulated machine takes minutes for it.

    Debian's Python uses it if it has this Python's version.
    """
    command = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "unchecked-hash", root]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=False)  # a library may hold files of another Python


def package_for(machine: Machine, package: str | None, folder: Path) -> dict[str, Path]:
    """The files of the gateway's Debian package, which is built unless one is named, by their place."""
    if package is None:
        build = [CHECKOUT / "deploy/build-deb", machine.architecture]
        built = subprocess.run(build, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=True)
        package = built.stdout.strip()
    subprocess.run(["dpkg-deb", "--extract", package, folder / "package"], check=True)
    return {each.name: each for each in (folder / "package").iterdir()}


class Booted:
    """A machine that runs, with its chardevs `console` and `line`; in its context."""

    def __init__(self, machine: Machine, debian: Path, initrd: Path, folder: Path, *words: str, mux: str = "") -> None:
        self._folder = folder
        self._command = (
            *machine.program, *words, "-smp", "2", "-m", "1024", "-nographic", "-no-reboot", "-nodefaults",
            "-kernel", next((debian / "boot").glob("vmlinuz-*")), "-initrd", initrd,
            "-append", "console=ttyS0 quiet panic=-1 no_timer_check",
            "-chardev", f"socket,id=console,path={folder}/console,server=on,wait=on",
            "-chardev", f"socket,id=line,path={folder}/line,server=on,wait=on{mux}",
            "-qmp", f"unix:{folder}/qmp,server=on,wait=off",
        )  # fmt: skip

    def __enter__(self) -> Self:
        # However this process ends, the machine ends with it.
        command = ("setpriv", "--pdeathsig", "KILL", *self._command)
        with ExitStack() as on_error:
            self._qemu = subprocess.Popen(command, stderr=subprocess.DEVNULL)
            on_error.callback(self._end)
            self.console = connected(self._folder / "console")
            self.line = connected(self._folder / "line")
            on_error.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _end(self) -> None:
        self._qemu.terminate()
        self._qemu.wait()

    def watch(self, wishes: Mapping[str, Callable[[], None]]) -> bool:
        """Show what the machine says, and do what it asks for; whether it says nothing is wrong until it is `done`."""
        self.console.settimeout(PATIENCE)
        went_well = True
        for text in map(str.strip, self.console.makefile(errors="replace")):
            print(text, flush=True)
            went_well = went_well and not text.startswith(("FAILED", "Traceback"))
            if text == "done":
                return went_well
            wishes.get(text, lambda: None)()
        return False

    def plug(self, device: str, name: str, **properties: str) -> None:
        """Plug in a device of qemu by this name."""
        self._monitor("device_add", driver=device, id=name, **properties)

    def unplug(self, name: str) -> None:
        """Unplug it; it is gone on return."""
        self._monitor("device_del", event="DEVICE_DELETED", id=name)

    def _monitor(self, command: str, event: str = "", **arguments: str) -> None:
        with connected(self._folder / "qmp") as sock, sock.makefile("rw") as monitor:
            sock.settimeout(PATIENCE)
            for each in ({"execute": "qmp_capabilities"}, {"execute": command, "arguments": arguments}):
                monitor.write(json.dumps(each))
                monitor.flush()
            returned = 0
            for said in map(json.loads, monitor):
                assert "error" not in said, said
                returned += "return" in said
                if returned == 2 and event in ("", said.get("event")):
                    return


def run_to_end(main: Callable[[], int]) -> NoReturn:
    """Be the process of a check. What it has made goes with it, also if it is stopped by SIGTERM."""
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    sys.exit(main())


def connected(path: Path) -> socket.socket:
    """A connection to what qemu listens on."""
    deadline = time.monotonic() + 20
    while True:
        sock = socket.socket(socket.AF_UNIX)
        try:
            sock.connect(str(path))
        except OSError:
            sock.close()
            if time.monotonic() > deadline:
                raise
            time.sleep(0.05)
        else:
            return sock


def answer_on(line: socket.socket, frames: Mapping[bytes, bytes]) -> None:
    """Be a device on a line, in a thread, until the connection ends: to each request its answer."""

    def serve() -> None:
        heard = b""
        with suppress(OSError):
            while data := line.recv(4096):
                heard += data
                for request, answer in frames.items():
                    if heard.endswith(request):
                        heard = b""
                        time.sleep(TURNAROUND)
                        line.sendall(answer)

    threading.Thread(target=serve, name="device", daemon=True).start()
