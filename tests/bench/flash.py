"""How many bytes a gateway writes to its disk in an hour: idle, and busy with values, a history and events.

    .venv/bin/python tests/bench/flash.py                   20 minutes, both at once
    .venv/bin/python tests/bench/flash.py --minutes 60 --meters 1 12

Idle is a gateway with meters that nobody reads. Busy are gateways with so many meters of 83 points, all of which are
polled each second, with a unit that is switched off and a client that asks for it and for another one that is not
there. What counts is what the kernel sends to the disk for the process (write_bytes in /proc/PID/io): whole pages of
the files in the state folder and of their logs, without what the file system writes for itself. Trends are written
every ten minutes, so minutes are tens. The first two minutes, in which files are made, do not count.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from socket import create_connection
from threading import Event, Thread

import programs

sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.process import COMMAND, GatewayProcess

WARM_UP = 120.0
#: Of the profile eastron-sdm630: what reads all of its 83 points, in as few requests as the meter takes.
BLOCKS = ("0-79", "80-107", "200-251", "258-269", "334-381")
#: Units that fail: one that is switched off, and one that is not there.
SILENT, UNKNOWN = 200, 201
#: How often the client asks for each of them, in seconds.
ASKS_EVERY = 5.0


def config(meters: int, server: int, port: int, page: int, *, is_busy: bool) -> str:
    """A gateway with these meters behind a server; one that is busy polls all their points."""
    devices = "".join(
        f'  {{ unit = {unit}, name = "meter-{unit}", profile = "eastron-sdm630" }},\n' for unit in range(1, meters + 1)
    )
    blocks = ", ".join(f'{{ input = "{block}", every = "1 s" }}' for block in BLOCKS)
    mirrors = (
        f'[[image]]\nunit = {100 + unit}\nname = "copy-{unit}"\nof = "meter-{unit}"\nread = [{blocks}]\n'
        for unit in range(1, meters + 1)
    )
    return (
        f'[[listen]]\nbind = "tcp://127.0.0.1:{port}"\n\n[web]\nbind = "http://127.0.0.1:{page}"\n\n'
        f'[[upstream]]\nname = "meters"\nto = "tcp://127.0.0.1:{server}"\nunits = [\n{devices}'
        f'  {{ unit = {SILENT}, name = "off", timeout = "200 ms" }},\n]\n\n' + ("".join(mirrors) if is_busy else "")
    )


@contextmanager
def asked_in_vain(port: int) -> Iterator[None]:
    """A client that asks for units that fail, inside the context."""
    ends = Event()

    def ask() -> None:
        with create_connection(("127.0.0.1", port), programs.PATIENCE) as client:
            while not ends.wait(ASKS_EVERY):
                for unit in (SILENT, UNKNOWN):
                    client.sendall(bytes((0, 1, 0, 0, 0, 6, unit, 3, 0, 0, 0, 1)))
                    client.recv(260)

    client = Thread(target=ask)
    client.start()
    try:
        yield
    finally:
        ends.set()
        client.join()


@contextmanager
def gateway(meters: int, *, is_busy: bool) -> Iterator[tuple[int, Path]]:
    """A gateway that runs inside the context: its process, and the folder of its state."""
    with ExitStack() as stack:
        folder = Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="flash.", dir="/var/tmp"))
        )  # not in memory
        server, port, page = (programs.free_port() for _ in range(3))
        simulate = [*COMMAND, "simulate", f"eastron-sdm630:1-{meters}", "--tcp", f"127.0.0.1:{server}"]
        simulator = programs.start(simulate, programs.processors()[0], stdout=subprocess.DEVNULL)
        stack.callback(programs.end, simulator)
        text = config(meters, server, port, page, is_busy=is_busy)
        process = stack.enter_context(GatewayProcess(folder, text, level="info"))
        if is_busy:
            stack.enter_context(asked_in_vain(port))
        yield process.pid, folder


def written(pid: int) -> int:
    """How many bytes a process has sent to disks."""
    lines = Path(f"/proc/{pid}/io").read_text(encoding="ascii").splitlines()
    return int(dict(line.split(": ") for line in lines)["write_bytes"])


def measure(minutes: int, sizes: Sequence[int]) -> None:
    """Print what each gateway writes in an hour."""
    with ExitStack() as stack:
        running = {"idle": stack.enter_context(gateway(max(sizes), is_busy=False))}
        running |= {
            f"busy, {meters * 83} points": stack.enter_context(gateway(meters, is_busy=True)) for meters in sizes
        }
        time.sleep(WARM_UP)
        before = {name: written(pid) for name, (pid, _) in running.items()}
        for minute in range(1, minutes + 1):
            time.sleep(60)
            print(f"\r{minute} of {minutes} min", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        for name, (pid, state) in running.items():
            hourly = (written(pid) - before[name]) * 60 / minutes
            sizes_of = ", ".join(f"{each.name} {each.stat().st_size / 1024:.0f}" for each in sorted(state.glob("*.*")))
            print(f"{name:20} {hourly / 2**20:6.2f} MiB/h   files in KiB: {sizes_of}")


def main() -> None:
    """Measure as the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, default=20, help="how long (default 20)")
    parser.add_argument("--meters", type=int, nargs="+", default=[1, 12], help="of the busy ones (default 1 12)")
    args = parser.parse_args()
    measure(args.minutes, args.meters)


if __name__ == "__main__":
    main()
