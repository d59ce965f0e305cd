"""Adapters on USB that are unplugged and plugged in again while the gateway uses them, in a machine of qemu.

    .venv/bin/python tests/qemu/usb.py
    .venv/bin/python tests/qemu/usb.py dist/modbus-gateway_0.1.0_amd64.deb

The adapters are an FTDI chip of qemu and a CDC-ACM device, a gadget of the kernel on a bus of its own. The kernel's
drivers, udev with our rules, and the gateway of the Debian package are real ones. It needs what qemu/machine.py and
deploy/build-deb ask for, and takes some minutes. Status 0 if all went well.
"""

import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from qemu.gateway_guest import OTHER_ANSWERS, frames
from qemu.machine import PC, Booted, answer_on, connected, debian_for, pack, package_for, run_to_end

#: What udev and the drivers need of the Debian.
TREE: Final = (
    *("sbin/*mod*", "bin/kmod", "bin/udevadm", "bin/sh", "bin/dash"),
    *("lib/modules/*/modules.*", "lib/modules/*/kernel/drivers/usb", "lib/modules/*/kernel/fs/configfs"),
    *("lib/udev", "lib/systemd/systemd-udev*", "etc/udev"),
)
INIT: Final = "/usr/bin/python3 /guest.py usb\n"


def main() -> int:
    """Boot the machine; status 0 if all went well."""
    debian = debian_for(PC, "udev", "kmod", "dash")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {
            **package_for(PC, next(iter(sys.argv[1:]), None), folder),
            "guest.py": Path(__file__).with_name("gateway_guest.py"),
        }
        initrd = pack(debian, INIT, files, folder, TREE)
        other = f"socket,id=other,path={folder}/other,server=on,wait=off"
        with Booted(PC, debian, initrd, folder, "-device", "qemu-xhci", "-chardev", other) as booted:
            answer_on(booted.line, frames())
            answer_on(connected(folder / "other"), frames(OTHER_ANSWERS))
            wishes = {
                "plug": partial(booted.plug, "usb-serial", "first", chardev="line", serial="SECRET7"),
                "plug the other": partial(booted.plug, "usb-serial", "second", chardev="other", serial="SECRET8"),
                "unplug": partial(booted.unplug, "first"),
                "unplug the other": partial(booted.unplug, "second"),
            }
            return 0 if booted.watch(wishes) else 1


if __name__ == "__main__":
    run_to_end(main)
