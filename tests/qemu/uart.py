"""What the gateway sets on a true UART: parity, rates, RS-485, in a machine of qemu that has one.

    .venv/bin/python tests/qemu/uart.py 8250
    .venv/bin/python tests/qemu/uart.py pl011

A pseudo-terminal has no parity, keeps every rate and knows nothing of RS-485. qemu's UARTs have the kernel's own
drivers: their flags are those of real ones. Damaged characters they do not make, only breaks. It takes a minute, needs
root and `apt install mmdebstrap cpio qemu-system-x86 qemu-system-arm`, and makes a Debian of half a gigabyte the first
time. Status 0 if all went well.
"""

import sys
import tempfile
import threading
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from socket import socket
from typing import Final

import serial
import serial_asyncio

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from qemu.machine import ARM, CHECKOUT, PC, Booted, debian_for, pack, run_to_end

#: The machine of a kind, more words for qemu, and the port under test.
KINDS: Final = {"8250": (PC, ("-serial", "chardev:line"), "/dev/ttyS1"), "pl011": (ARM, (), "/dev/ttyAMA0")}
INIT: Final = "PYTHONPATH=/gateway /usr/bin/python3 /gateway/uart_guest.py {port} {kind}\n"


def send_a_break(line: socket) -> None:
    """Send a character, a break, and another character."""
    for each in (b"A", b"\x01b", b"B"):  # how a multiplexed character device of qemu is told
        line.sendall(each)
        time.sleep(0.5)  # its 8250 has one flag for all characters that it holds


class Bus:
    """Two others on a bus who talk while they are told to; the machine should only hear them."""

    def __init__(self, line: socket) -> None:
        self._line = line
        self._may_talk = threading.Event()
        threading.Thread(target=self._talk, daemon=True).start()

    def tell(self) -> None:
        """Say how many bytes the machine has sent until now."""
        self._line.setblocking(False)
        sent = 0
        with suppress(BlockingIOError):
            while data := self._line.recv(4096):
                sent += len(data)
        self._line.setblocking(True)
        print(f"{'ok' if sent == 0 else 'FAILED'}: bytes that a port that listens has sent: {sent}", flush=True)

    def talk(self) -> None:
        """Begin to talk."""
        self._may_talk.set()

    def be_silent(self) -> None:
        """Be silent."""
        self._may_talk.clear()

    def _talk(self) -> None:
        while True:
            self._may_talk.wait()
            self._line.sendall(b"ask\n")
            time.sleep(4 * 10 / 19200)


def main() -> int:
    """Boot the machine; status 0 if all went well."""
    kind = sys.argv[1]
    machine, words, port = KINDS[kind]
    debian = debian_for(machine)
    modules = (CHECKOUT / "gateway", Path(serial.__file__).parent, Path(serial_asyncio.__file__).parent)
    files = {f"gateway/{source.name}": source for source in (*modules, Path(__file__).with_name("uart_guest.py"))}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        initrd = pack(debian, INIT.format(port=port, kind=kind), files, folder)
        with Booted(machine, debian, initrd, folder, *words, mux=",mux=on") as booted:
            bus = Bus(booted.line)
            wishes = {
                "talk": bus.talk,
                "be silent": bus.be_silent,
                "nothing was sent": bus.tell,
                "send a break": partial(send_a_break, booted.line),
            }
            return 0 if booted.watch(wishes) else 1


if __name__ == "__main__":
    run_to_end(main)
