"""What the gateway sets on a true UART: parity, rates, RS-485, in a machine of qemu that has one.

    .venv/bin/python tests/soak/uart.py 8250
    .venv/bin/python tests/soak/uart.py pl011

A pseudo-terminal has no parity, keeps every rate and knows nothing of RS-485. qemu's UARTs have the kernel's own
drivers: their flags are those of real ones. Damaged characters they do not make, only breaks. It takes a minute, needs
root and `apt install mmdebstrap cpio qemu-system-x86 qemu-system-arm`, and makes a Debian of half a gigabyte the first
time. Status 0 if all went well.
"""

import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import serial

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit.system_tree import make, system_tree

#: How long a machine may say nothing, in seconds.
PATIENCE = 120
GUEST = Path(__file__).with_name("uart_guest.py")
GATEWAY = Path(__file__).resolve().parents[2] / "gateway"
#: What the machine runs as its first process.
INIT = """\
#!/bin/busybox sh
busybox mount -t proc proc /proc
busybox mount -t sysfs sys /sys
busybox mount -t devtmpfs dev /dev
PYTHONPATH=/gateway PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 /gateway/uart_guest.py {port} {kind}
busybox poweroff -f
"""
#: What of the Debian is needed. Its kernel has the drivers built in.
TREE = (
    "usr/bin/python3*",
    "usr/lib/python3*",
    "usr/lib/*-linux-gnu*",
    "lib/*-linux-gnu*",
    "lib/ld-*",
    "lib64",
    "bin/busybox",
)


class Machine(NamedTuple):
    """A machine whose UART under test is `port`; its console is another one."""

    architecture: str
    port: str
    program: tuple[str, ...]

    @property
    def make(self) -> tuple[str, ...]:
        """What makes its Debian: only unpacked, so that it may be of another architecture."""
        packages = f"linux-image-{self.architecture},python3-minimal,libpython3-stdlib,busybox-static"
        return (
            "mmdebstrap",
            "--quiet",
            "--variant=extract",
            f"--architectures={self.architecture}",
            f"--include={packages}",
        )


MACHINES = {
    "8250": Machine(
        "amd64", "/dev/ttyS1", ("qemu-system-x86_64", "-serial", "chardev:console", "-serial", "chardev:line")
    ),
    "pl011": Machine(
        "arm64",
        "/dev/ttyAMA0",
        ("qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a57", "-serial", "chardev:line",
         "-device", "pci-serial,chardev=console"),
    ),
}  # fmt: skip


def pack(machine: Machine, kind: str, debian: Path, folder: Path) -> Path:
    """The machine's file system, in a file that the kernel unpacks."""
    root = folder / "root"
    for mount in ("proc", "sys", "dev", "tmp", "gateway"):
        (root / mount).mkdir(parents=True)
    for pattern in TREE:
        for source in debian.glob(pattern):
            target = root / source.relative_to(debian)
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir() and not source.is_symlink():
                shutil.copytree(source, target, symlinks=True)
            else:
                shutil.copy(source, target, follow_symlinks=False)
    for source in (GATEWAY, Path(serial.__file__).parent):
        shutil.copytree(source, root / "gateway" / source.name, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    shutil.copy(GUEST, root / "gateway")
    (root / "init").write_text(INIT.format(port=machine.port, kind=kind))
    (root / "init").chmod(0o755)
    packed = folder / "initrd"
    with packed.open("wb") as file:
        subprocess.run("find . | cpio --quiet -o -H newc", shell=True, cwd=root, stdout=file, check=True)
    return packed


def run(machine: Machine, debian: Path, initrd: Path, folder: Path) -> bool:
    """Boot the machine and show what it says; whether all went well."""
    kernel = next((debian / "boot").glob("vmlinuz-*"))
    line, console = folder / "line", folder / "console"
    command = (
        *machine.program, "-m", "1024", "-nographic", "-no-reboot", "-nodefaults", "-kernel", kernel, "-initrd", initrd,
        "-append", "console=ttyS0 quiet panic=-1",
        "-chardev", f"socket,id=console,path={console},server=on,wait=on",
        "-chardev", f"socket,id=line,path={line},server=on,wait=on,mux=on",
    )  # fmt: skip
    qemu = subprocess.Popen(command)
    try:
        return watch(connected(console), connected(line))
    finally:
        qemu.terminate()
        qemu.wait()


def connected(path: Path) -> socket.socket:
    """A connection to what qemu listens on."""
    deadline = time.monotonic() + 20
    sock = socket.socket(socket.AF_UNIX)
    while True:
        try:
            sock.connect(str(path))
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.05)
        else:
            return sock


def watch(console: socket.socket, line: socket.socket) -> bool:
    """Show what the machine says, and do on the line what it asks for; whether it has said nothing else than ok."""
    console.settimeout(PATIENCE)
    went_well = True
    for text in map(str.strip, console.makefile(errors="replace")):
        print(text, flush=True)
        went_well = went_well and not text.startswith(("FAILED", "Traceback"))
        if text == "send a break":
            for each in (b"A", b"\x01b", b"B"):  # how a multiplexed character device of qemu is told
                line.sendall(each)
                time.sleep(0.5)  # its 8250 has one flag for all characters that it holds
        elif text == "done":
            return went_well
    return False


def main() -> int:
    kind = sys.argv[1]
    machine = MACHINES[kind]
    make(command=machine.make)
    debian = system_tree(command=machine.make)
    with tempfile.TemporaryDirectory() as folder:
        initrd = pack(machine, kind, debian, Path(folder))
        return 0 if run(machine, debian, initrd, Path(folder)) else 1


if __name__ == "__main__":
    sys.exit(main())
