"""The Debian package for a kind of machine, on such a machine of qemu, with a line at a UART.

    .venv/bin/python tests/qemu/package.py arm64
    .venv/bin/python tests/qemu/package.py amd64 dist/modbus-gateway_0.1.0_amd64.deb

It is unpacked, not installed (that is what soak/package.py does): the libraries and the gateway run, on the driver of
a PL011 with RS-485, or on that of an 8250. It needs what qemu/machine.py and deploy/build-deb ask for, and takes some
minutes. Status 0 if all went well.
"""

import sys
import tempfile
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from qemu.gateway_guest import frames
from qemu.machine import ARM, PC, Booted, answer_on, debian_for, pack, package_for, run_to_end

#: The machine, more words for qemu, the port, and who switches the line there.
KINDS: Final = {
    "arm64": (ARM, (), "/dev/ttyAMA0", "kernel"),
    "amd64": (PC, ("-serial", "chardev:line"), "/dev/ttyS1", "adapter"),
}
INIT: Final = "/usr/bin/python3 /guest.py package {port} {rs485}\n"


def main() -> int:
    """Boot the machine; status 0 if all went well."""
    machine, words, port, rs485 = KINDS[sys.argv[1]]
    debian = debian_for(machine, "dash")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {
            **package_for(machine, next(iter(sys.argv[2:]), None), folder),
            "guest.py": Path(__file__).with_name("gateway_guest.py"),
        }
        initrd = pack(debian, INIT.format(port=port, rs485=rs485), files, folder, ("bin/sh", "bin/dash"))
        with Booted(machine, debian, initrd, folder, *words) as booted:
            answer_on(booted.line, frames())
            return 0 if booted.watch({}) else 1


if __name__ == "__main__":
    run_to_end(main)
