"""`doctor --hardware-report` as a process, of a simulated port with a device, and with a person who unplugs it."""

import json
import os
import pty
import subprocess
import sys

from kit.process import PATIENCE, command
from kit.pty import VirtualPort
from system.test_simulate import Simulation


def rows_of(printed, title):
    (rows,) = (each["rows"] for each in json.loads(printed)["sections"] if each["title"] == title)
    return {row["what"]: row["seen"] for row in rows}


def test_it_reads_a_unit_and_says_what_was_not_done(tmp_path):
    with Simulation(tmp_path / "port", "weigher:1"):
        done = command("doctor", "--hardware-report", str(tmp_path / "port"), "--unit", "1", "--baud", "9600", "--json")
    assert done.returncode == 0, done.stderr
    assert rows_of(done.stdout, "Unit 1")["reads"].startswith("20: ")
    assert "answered" in rows_of(done.stdout, "Unit 1")["reads"]
    assert rows_of(done.stdout, "Driver")["opens at"].startswith("any rate and format")
    assert list(rows_of(done.stdout, "By hand")) == ["not done"]


def test_a_port_that_is_absent_is_an_error_with_what_to_do(tmp_path):
    done = command("doctor", "--hardware-report", str(tmp_path / "port"))
    assert done.returncode == 1
    assert "does not exist: is the adapter plugged in?" in done.stderr
    assert "Traceback" not in done.stderr


def test_who_sits_at_the_terminal_is_asked_to_unplug(tmp_path):
    with VirtualPort(tmp_path / "port") as port, Terminal("doctor", "--hardware-report", str(port.path)) as terminal:
        terminal.wait_for("Enter to begin, s to skip: ")
        terminal.type("\n")
        terminal.wait_for("Unplug the adapter now.")
        port.unplug()
        terminal.wait_for("Plug it in again.")
        port.plug()
        terminal.wait_for("plugged in again")
        said = terminal.rest()
    assert "opened, as " in said
    assert "is gone" in terminal.heard


class Terminal:
    """The program at a terminal of its own. `heard` is all that it has printed."""

    def __init__(self, *words):
        self.heard = ""
        self._ours, theirs = pty.openpty()
        program = [sys.executable, "-P", "-m", "gateway.cli.main", *words]
        self._process = subprocess.Popen(program, stdin=theirs, stdout=theirs, stderr=theirs)
        os.close(theirs)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait(PATIENCE)
        os.close(self._ours)

    def type(self, text):
        os.write(self._ours, text.encode())

    def wait_for(self, text):
        while text not in self.heard:
            self.heard += os.read(self._ours, 4096).decode()

    def rest(self):
        """What is printed until the program ends."""
        rest = ""
        while True:
            try:
                data = os.read(self._ours, 4096).decode()
            except OSError:  # nobody has its end open any more
                self.heard += rest
                return self.heard
            rest += data
