"""The checks in tests/qemu leave no machine behind; qemu itself and a Debian are not needed for that."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from kit.process import PATIENCE

TESTS = Path(__file__).resolve().parents[1]
#: In place of qemu: it listens where it is connected to, and has `alive` open for as long as it lives.
MACHINE = """\
#!{python}
import signal, socket
from pathlib import Path

folder = Path(__file__).parent
alive = open(folder / "alive", "w")
doors = []
for name in ("console", "line"):
    doors.append(socket.socket(socket.AF_UNIX))
    doors[-1].bind(str(folder / name))
    doors[-1].listen()
connections = [door.accept() for door in doors]
alive.write("booted\\n")
alive.flush()
signal.alarm({patience})
signal.pause()
"""
CHECK = """\
import sys
from pathlib import Path
from qemu.machine import Booted, Machine, run_to_end

folder = Path(sys.argv[1])

def main():
    with Booted(Machine("none", (str(folder / "machine"),)), folder, folder / "initrd", folder) as booted:
        return booted.watch({})

run_to_end(main)
"""


@pytest.fixture
def check(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A check that waits for its machine."""
    (tmp_path / "boot").mkdir()
    (tmp_path / "boot/vmlinuz-1").touch()
    (tmp_path / "machine").write_text(MACHINE.format(python=sys.executable, patience=3 * int(PATIENCE)))
    (tmp_path / "machine").chmod(0o755)
    os.mkfifo(tmp_path / "alive")
    with subprocess.Popen([sys.executable, "-c", CHECK, tmp_path], env={**os.environ, "PYTHONPATH": str(TESTS)}) as run:
        yield run
        run.kill()


@pytest.mark.timeout(3 * PATIENCE)
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_a_check_that_is_stopped_takes_its_machine_with_it(
    tmp_path: Path, check: subprocess.Popen[bytes], number: int, code: int
) -> None:
    with (tmp_path / "alive").open() as alive:
        assert alive.readline() == "booted\n"
        check.send_signal(number)
        assert check.wait(PATIENCE) == code
        assert select.select([alive], [], [], PATIENCE)[0], "it has ended"
        assert alive.read() == ""
