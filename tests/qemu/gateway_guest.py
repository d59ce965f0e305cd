"""What qemu/usb.py and qemu/package.py run in a machine: the gateway of the Debian package, and a client of it.

It prints a line for each check, `ok` or `FAILED` and what was seen, and for each wish what the other end shall do.
"""

import os
import socket
import subprocess
import sys
import termios
import threading
import time
import tty
from collections import Counter
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

#: Emulated machines are slow, and ours may be busy: on two cores with a load of 20 the gateway took 120 s to start.
PATIENCE = 600
#: How long a device takes to respond, in seconds. qemu has no wire: a response would come while the request is still
#: being sent, at its rate, and the gateway takes no such response for its own.
TURNAROUND = 0.05
CONFIG = """\
[[listen]]
bind = "tcp://127.0.0.1:1502"
[control]
socket = "/tmp/control.sock"
"""
LINE = """\
[[line]]
name = "of unit {unit}"
port = "{port}"
baud = 19200
rs485 = "{rs485}"
latency = "2 s"
devices = [{{ unit = {unit}, timeout = "10 s" }}]
"""
#: FC 03, one register at address 0, of unit 5; and FC 06 to it. Both without header and CRC.
READ, WRITE = bytes.fromhex("05 03 0000 0001"), bytes.fromhex("05 06 0000 0042")
#: FC 03 to unit 6.
OTHER_READ = b"\x06" + READ[1:]
#: Each end answers for both units, with a value of its own, which tells whether an adapter was taken for the other one.
ANSWERS = {READ: bytes.fromhex("03 02 002A"), OTHER_READ: bytes.fromhex("03 02 002A"), WRITE: WRITE[1:]}
OTHER_ANSWERS = {READ: bytes.fromhex("03 02 0007"), OTHER_READ: bytes.fromhex("03 02 0007")}
#: The gateway has no way to the unit, or the unit does not respond.
IS_DOWN = ({0x83, 0x0A}, {0x83, 0x0B})
GADGET = Path("/sys/kernel/config/usb_gadget/adapter")


def check(what, seen, *, holds):
    print(f"{'ok' if holds else 'FAILED'}: {what}: {seen}", flush=True)


def wish(what):
    print(what, flush=True)


def until(holds, what):
    """Wait for it; the seconds that it took."""
    began = time.monotonic()
    while not holds():
        if time.monotonic() > began + PATIENCE:
            check(what, f"not within {PATIENCE} s", holds=False)
            break
        time.sleep(0.25)
    return time.monotonic() - began


@contextmanager
def gateway(ports, rs485="adapter"):
    """The gateway, with a line for each unit of `ports`."""
    lines = (LINE.format(unit=unit, port=port, rs485=rs485) for unit, port in ports.items())
    Path("/tmp/gateway.toml").write_text(CONFIG + "".join(lines))
    with Path("/tmp/log").open("w") as log:
        running = subprocess.Popen(["modbus-gateway", "run", "/tmp/gateway.toml"], stdout=log, stderr=log)
        try:
            yield
        finally:
            running.terminate()
            check("the gateway ends when it is told to", running.wait(PATIENCE), holds=running.returncode == 0)
            print(Path("/tmp/log").read_text(), flush=True)


def ask(request):
    """The PDU of the response through the gateway; empty if there is none."""
    with suppress(OSError), socket.create_connection(("127.0.0.1", 1502), PATIENCE) as client:
        client.sendall(bytes((0, 1, 0, 0, 0, len(request))) + request)
        return client.recv(260)[7:]
    return b""


def is_down(request=READ):
    return set(ask(request)) in IS_DOWN


def is_refusal(said):
    """Or nothing, while the gateway starts."""
    return not said or set(said) in IS_DOWN


def check_answers(what, request=READ, answer=ANSWERS[READ]):
    """Wait until it is answered; until then the gateway may only say that it has no way, or that it did not respond.

    It says 0B for half a minute if a request was on the line when the adapter was unplugged: the response may be late.
    """
    others = Counter()

    def answers():
        said = ask(request)
        if said != answer:
            others[said] += 1
        return said == answer

    seconds = until(answers, what)
    seen = ", ".join(f"{times} times {said.hex() or 'nothing'}" for said, times in others.items())
    check(what, f"after {seconds:.1f} s, before that {seen or 'nothing else'}", holds=all(map(is_refusal, others)))


def report_of(port):
    """What `doctor --hardware-report` prints."""
    words = ["doctor", "--hardware-report", port, "--unit", "5", "--json"]
    done = subprocess.run(
        ["modbus-gateway", *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, check=False
    )
    return done.stdout


def check_report(port, *expected):
    seen = report_of(port)
    for text in (*expected, "20 answered"):
        check(f"the report of the adapter has {text}", text in seen or seen, holds=text in seen)
    check("the report has no serial number", "SECRET7" not in seen, holds="SECRET7" not in seen)


def link(serial="SECRET7"):
    """The stable link that udev has made for an adapter; empty if there is none."""
    return next(map(str, Path("/dev/serial/by-id").glob(f"*{serial}*")), "")


def node(serial="SECRET7"):
    """What the link leads to."""
    return Path(link(serial)).resolve().name


def check_replugging(what, plug, unplug):
    """Unplug an adapter while the gateway uses it, and plug it in again, three times."""
    plug()
    until(link, f"{what}: udev makes a stable link")
    port = link()
    check(f"{what}: its stable link", f"{port} to {node()}", holds=True)
    with gateway({5: port}):
        check_answers(f"{what}: the unit answers")
        held = None
        for number in range(3):
            if number == 1:
                held = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)  # so that its name stays taken
            unplug()
            seconds = until(is_down, f"{what}: clients are told that it is unplugged")
            check(f"{what}: unplugged, clients are told", f"after {seconds:.1f} s, {ask(READ).hex()}", holds=is_down())
            until(lambda: not link(), f"{what}: its link is gone")
            plug()
            check_answers(f"{what}: plugged in again, the unit answers")
            check(f"{what}: the same link", f"{link()} to {node()}", holds=link() == port)
        os.close(held)
    return port


def ftdi():
    port = check_replugging("FTDI", lambda: wish("plug"), lambda: wish("unplug"))
    check_report(port, "0403:6001", "ftdi_sio", "serial/by-id")
    timer = Path(f"/sys/class/tty/{node()}/device/latency_timer").read_text().strip()
    check("FTDI: its latency timer, by our udev rule", timer, holds=timer == "1")
    wish("unplug")
    until(lambda: not link(), "FTDI: its link is gone")


def two_adapters():
    """Two alike, of which one is unplugged; then both, and plugged in again in the other order."""
    wish("plug")
    until(link, "two adapters: the first one has a link")
    wish("plug the other")
    until(partial(link, "SECRET8"), "two adapters: the second one has a link")
    check("two adapters", f"{node()} and {node('SECRET8')}", holds=(node(), node("SECRET8")) == ("ttyUSB0", "ttyUSB1"))
    with gateway({5: link(), 6: link("SECRET8")}):
        check_both("two adapters")
        wish("unplug the other")
        until(partial(is_down, OTHER_READ), "two adapters: the second one is told to be unplugged")
        check("the second one is unplugged, the first one", ask(READ).hex(), holds=ask(READ) == ANSWERS[READ])
        wish("unplug")
        until(is_down, "two adapters: the first one is told to be unplugged")  # then its name is free
        until(lambda: not (link() or link("SECRET8")), "two adapters: both are gone")
        wish("plug the other")
        until(partial(link, "SECRET8"), "two adapters: the second one has a link again")
        wish("plug")
        check_both("plugged in again in the other order")
        swapped = (node(), node("SECRET8"))
        check("their names are the other way round", " and ".join(swapped), holds=swapped == ("ttyUSB1", "ttyUSB0"))
    wish("unplug")
    wish("unplug the other")
    until(lambda: not (link() or link("SECRET8")), "two adapters: both are gone")


def check_both(what):
    check_answers(f"{what}: the unit at the first one answers")
    check_answers(f"{what}: the unit at the second one answers", OTHER_READ, OTHER_ANSWERS[OTHER_READ])


def cdc_acm():
    """The kernel is both ends here: a gadget with the function ACM on a bus that is none."""
    for module in ("dummy_hcd", "libcomposite", "usb_f_acm"):
        subprocess.run(["modprobe", module], check=True)
    subprocess.run(["busybox", "mount", "-t", "configfs", "config", "/sys/kernel/config"], check=True)
    for folder in ("strings/0x409", "configs/c.1", "functions/acm.0"):
        (GADGET / folder).mkdir(parents=True)
    for file, text in {"idVendor": "0x1d6b", "idProduct": "0x0104", "strings/0x409/serialnumber": "SECRET7"}.items():
        (GADGET / file).write_text(text)
    (GADGET / "configs/c.1/acm.0").symlink_to(GADGET / "functions/acm.0")

    def plug():
        (GADGET / "UDC").write_text("dummy_udc.0")
        threading.Thread(target=be_device, args=("/dev/ttyGS0",), daemon=True).start()

    port = check_replugging("CDC-ACM", plug, lambda: (GADGET / "UDC").write_text("\n"))
    check_report(port, "1d6b:0104", "cdc_acm")


def be_device(node):
    """Answer the read at the other end, until it is gone."""
    with suppress(OSError, termios.error):
        descriptor = os.open(node, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(descriptor)
        heard = b""
        while data := os.read(descriptor, 256):
            heard += data
            for request, answer in frames().items():
                if heard.endswith(request):
                    time.sleep(TURNAROUND)
                    os.write(descriptor, answer)
                    heard = b""
        os.close(descriptor)


def with_crc(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 * (crc & 1)
    return data + crc.to_bytes(2, "little")


def frames(answers=ANSWERS):
    """What a device at the other end hears, and what it answers, as RTU frames."""
    return {with_crc(request): with_crc(request[:1] + answer) for request, answer in answers.items()}


def package(port, rs485):
    """The package itself, and a line at a UART."""
    for words in (["--version"], ["demo", "--once"]):
        done = subprocess.run(
            ["modbus-gateway", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        last = done.stdout.strip().rpartition("\n")[2]
        is_fine = done.returncode == 0
        check(f"modbus-gateway {' '.join(words)}", last if is_fine else done.stdout, holds=is_fine)
    with gateway({5: port}, rs485):
        check_answers("the unit answers")
        check("a write", ask(WRITE).hex(), holds=ask(WRITE) == ANSWERS[WRITE])
    check_report(port, "counts wrong characters", '"8O1"')


def main(kind, *words):
    subprocess.run(["busybox", "ip", "link", "set", "lo", "up"], check=True)
    Path("/etc/group").write_text("root:x:0:\ntty:x:5:\ndialout:x:20:\n")
    Path("/etc/passwd").write_text("root:x:0:0:root:/root:/bin/sh\n")
    if kind == "usb":
        subprocess.run(["depmod", "-a"], check=True)
        subprocess.run(["/usr/lib/systemd/systemd-udevd", "--daemon"], check=True)
        subprocess.run(["udevadm", "trigger", "--action=add"], check=True)
        ftdi()
        two_adapters()
        cdc_acm()
    else:
        package(*words)
    print("done", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
