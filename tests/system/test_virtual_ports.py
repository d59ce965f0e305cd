"""Virtual ports of a real gateway: programs of this machine that know serial ports only."""

import grp
import json
import os
import select
import shutil
import signal
import stat
import subprocess
import termios
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Self

import pytest

from gateway.modbus.rtu import crc_fits, encode
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name    = "hall"
port    = "{hall}"
devices = [{{ unit = 1, name = "slow", timeout = "20 s" }}]

[[line]]
name   = "old-hmi"
port   = "pty:{name}"
role   = "server"
serves = "all"
answer_within = "20 s"

[[image]]
unit = 200
holding = "0-124"
initial.holding = [{{ at = 0, values = [11, 22, 33] }}]
"""
READ = bytes.fromhex("03 0000 0002")
RIGHT = encode(200, bytes.fromhex("03 04 000B 0016"))
#: How long nothing must come for a program to have got no response, in seconds.
SILENCE = 0.3
#: An old program, as libmodbus's own examples are.
LIBMODBUS_PROGRAM = r"""
#include <modbus.h>
#include <stdio.h>
int main(int count, char **words) {
    for (int again = 0; again < 2; again++) {
        uint16_t values[2];
        modbus_t *port = modbus_new_rtu(words[1], 9600, 'N', 8, 1);
        modbus_set_slave(port, 200);
        modbus_set_response_timeout(port, 60, 0);
        if (modbus_connect(port)) { perror("connect"); return 1; }
        if (modbus_write_register(port, 5, 70 + again) != 1) { perror("write"); return 1; }
        if (modbus_read_registers(port, 0, 2, values) != 2) { perror("read"); return 1; }
        printf("%d %d ", values[0], values[1]);
        if (modbus_read_registers(port, 5, 1, values) != 1) { perror("read"); return 1; }
        printf("%d\n", values[0]);
        modbus_close(port);
        modbus_free(port);
    }
    return 0;
}
"""


class Program:
    """A program that has the port open."""

    def __init__(self, link: Path) -> None:
        self.descriptor = os.open(link, os.O_RDWR | os.O_NOCTTY)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    def ask(self, pdu: bytes = READ, unit: int = 200) -> None:
        os.write(self.descriptor, encode(unit, pdu))

    def heard(self, seconds: float = SILENCE) -> bytes:
        """What comes until `seconds` have passed without anything, or a frame is complete."""
        data = b""
        while not (data and crc_fits(data)) and select.select([self.descriptor], [], [], seconds)[0]:
            data += os.read(self.descriptor, 300)
        return data

    def answer(self, pdu: bytes = READ, unit: int = 200) -> bytes:
        self.ask(pdu, unit)
        return self.heard(PATIENCE)


class Running:
    """A gateway with a slow device, and the link of its virtual port."""

    def __init__(self, folder: Path, parts: ExitStack, name: str = "ttyHMI") -> None:
        hall = parts.enter_context(VirtualPort(folder / "hall"))
        self.device = SimulatedDevice(1, delay=0.3)
        parts.enter_context(SerialDevices({hall: SimulatedLine("rtu", self.device)}))
        self.config = CONFIG.format(hall=hall.path, name=name)
        self.gateway = parts.enter_context(GatewayProcess(folder, self.config))
        self.link = folder / name

    def reload(self, config: str) -> None:
        self.gateway.config.write_text(f'{config}\n[log]\nformat = "json"\nlevel = "debug"\n')
        self.gateway.signal(signal.SIGHUP)
        self.gateway.wait_for("config_applied")


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with ExitStack() as parts:
        yield Running(tmp_path, parts)


def ask_and_never_read(program: Program) -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        program.ask(bytes.fromhex("03 0000 007D"))
        time.sleep(0.003)  # requests that come together are dropped


def until(is_so: object) -> None:
    deadline = time.monotonic() + PATIENCE
    while not is_so():  # type: ignore[operator]
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_a_program_reads_and_writes(running: Running) -> None:
    with Program(running.link) as program:
        assert program.answer() == RIGHT
        assert program.answer(bytes.fromhex("06 0004 1234")) == encode(200, bytes.fromhex("06 0004 1234"))
        assert program.answer(bytes.fromhex("03 0004 0001")) == encode(200, bytes.fromhex("03 02 1234"))


def test_the_port_is_raw_and_silent_before_anybody_has_set_it(running: Running) -> None:
    with Program(running.link) as program:
        flags = termios.tcgetattr(program.descriptor)
        assert not flags[3] & (termios.ECHO | termios.ICANON | termios.ISIG | termios.IEXTEN)
        assert not flags[1] & termios.OPOST
        assert program.heard() == b""
        assert program.answer(bytes.fromhex("03 0000 0003"))  # its frame has 03, 0A and other control characters


def test_owner_and_group_may_open_it(running: Running) -> None:
    status = running.link.stat()
    assert stat.S_ISCHR(status.st_mode)
    assert stat.S_IMODE(status.st_mode) == 0o660
    assert status.st_gid == grp.getgrnam("dialout").gr_gid


def test_each_program_gets_its_own_responses(running: Running) -> None:
    with Program(running.link) as first:
        assert first.answer() == RIGHT
        with Program(running.link) as second:
            first.ask(unit=1)
            assert second.answer() == RIGHT
            assert second.heard() == b""
            assert first.heard(PATIENCE) == encode(1, bytes.fromhex("03 04 0000 0000"))


def test_programs_that_have_opened_it_before_anybody_has_asked_get_their_own_responses_too(running: Running) -> None:
    with Program(running.link) as first:
        time.sleep(SILENCE)
        with Program(running.link) as second:
            first.ask(unit=1)
            assert second.answer() == RIGHT
            assert second.heard() == b""
            assert first.heard(PATIENCE) == encode(1, bytes.fromhex("03 04 0000 0000"))


def test_what_a_program_had_asked_that_was_killed_is_no_answer_for_the_next_one(running: Running) -> None:
    child = os.fork()
    if child == 0:
        Program(running.link).ask(unit=1)
        time.sleep(PATIENCE)
        os._exit(1)
    until(lambda: running.device.heard)
    os.kill(child, signal.SIGKILL)
    with Program(running.link) as second:
        assert second.heard(1.0) == b""
        assert second.answer() == RIGHT
    os.waitpid(child, 0)


def test_what_a_program_has_not_read_is_no_answer_for_the_next_one(running: Running) -> None:
    first = Program(running.link)
    first.ask()
    assert select.select([first.descriptor], [], [], PATIENCE)[0]
    first.close()
    with Program(running.link) as second:
        assert second.heard() == b""


def test_a_write_of_a_program_that_closes_at_once_is_given_up(running: Running) -> None:
    """Also while the gateway stands still, and the next program comes meanwhile."""
    running.gateway.signal(signal.SIGSTOP)
    with Program(running.link) as first:
        first.ask(bytes.fromhex("06 0004 0BAD"))
    with Program(running.link) as second:
        running.gateway.signal(signal.SIGCONT)
        assert second.heard() == b""
        assert second.answer(bytes.fromhex("03 0004 0001")) == encode(200, bytes.fromhex("03 02 0000"))


def test_a_program_that_has_only_looked_harms_nobody(running: Running) -> None:
    for _ in range(20):
        Program(running.link).close()
        with Program(running.link) as second:
            assert second.answer() == RIGHT


def test_a_write_is_done_once_though_the_program_has_set_an_echo(running: Running) -> None:
    write = bytes.fromhex("06 0004 0007")
    with Program(running.link) as program:
        attributes = termios.tcgetattr(program.descriptor)
        attributes[3] = termios.ECHO
        termios.tcsetattr(program.descriptor, termios.TCSANOW, attributes)
        assert program.answer(write) == encode(200, write)
        assert program.heard() == b""
        assert program.answer() == RIGHT


def test_the_link_leads_to_another_port_once_the_last_program_has_closed_it(running: Running) -> None:
    before = running.link.readlink()
    Program(running.link).close()
    until(lambda: running.link.readlink() != before)


def test_a_program_that_does_not_read_loses_its_port(running: Running) -> None:
    with Program(running.link) as program, pytest.raises(OSError, match="Input/output"):
        ask_and_never_read(program)


def test_a_gateway_with_no_program_does_not_spin(running: Running) -> None:
    with Program(running.link) as program:
        assert program.answer() == RIGHT
    fields = Path(f"/proc/{running.gateway.pid}/stat")
    used = [sum(map(int, fields.read_text().split()[13:15])) for _ in (0, 1) if not time.sleep(1.0)]
    assert used[1] - used[0] < 0.3 * os.sysconf("SC_CLK_TCK")


def test_the_link_is_gone_when_the_gateway_has_stopped(running: Running) -> None:
    with Program(running.link) as program:
        assert program.answer() == RIGHT
        assert running.gateway.stop() == 0
        assert not os.path.lexists(running.link)
        with pytest.raises(OSError, match="Input/output"):
            program.ask()


def test_the_link_of_a_killed_gateway_is_replaced(tmp_path: Path) -> None:
    with ExitStack() as parts:
        running = Running(tmp_path, parts)
        running.gateway.signal(signal.SIGKILL)
        running.gateway.wait()
        left = running.link.readlink()
        with GatewayProcess(tmp_path, running.config), Program(running.link) as program:
            assert program.answer() == RIGHT
        assert left


@pytest.mark.parametrize("kind", ["file", "link to a file", "folder"])
def test_what_a_user_has_there_is_never_touched(tmp_path: Path, kind: str) -> None:
    there, kept = tmp_path / "ttyHMI", tmp_path / "kept"
    kept.write_text("kept")
    if kind == "file":
        there.write_text("kept")
    elif kind == "folder":
        there.mkdir()
    else:
        there.symlink_to(kept)
    with ExitStack() as parts:
        running = Running(tmp_path, parts)
        reason = running.gateway.first("line_lost")["reason"]
        assert reason == f"{there} is there already and is not a virtual port: move it, or use another name"
        assert running.gateway.stop() == 0
    assert there.is_dir() if kind == "folder" else there.read_text() == "kept"


def test_a_link_that_was_replaced_by_another_gateway_is_left_to_it(running: Running, tmp_path: Path) -> None:
    running.link.unlink()
    running.link.symlink_to(tmp_path / "elsewhere")
    assert running.gateway.stop() == 0
    assert running.link.readlink() == tmp_path / "elsewhere"


def test_programs_stay_connected_over_a_reload_that_adds_a_unit(running: Running) -> None:
    with Program(running.link) as program:
        assert program.answer() == RIGHT
        program.ask(unit=201)
        assert program.heard() == b""
        running.reload(running.config + "\n[[image]]\nunit = 201\nholding = 1\n")
        assert program.answer() == RIGHT
        assert program.answer(bytes.fromhex("03 0000 0001"), unit=201) == encode(201, bytes.fromhex("03 02 0000"))


def test_a_reload_that_changes_the_line_makes_the_port_anew(running: Running) -> None:
    with Program(running.link) as program:
        assert program.answer() == RIGHT
        running.reload(running.config.replace('serves = "all"', 'serves = "all"\non_failure = "silent"'))
        with pytest.raises(OSError, match="Input/output"):
            until(program.ask)
    until(running.link.exists)
    with Program(running.link) as program:
        assert program.answer() == RIGHT


def test_another_path(tmp_path: Path) -> None:
    (tmp_path / "ports").mkdir()
    with ExitStack() as parts:
        link = str(tmp_path / "ports/com1")
        running = Running(tmp_path, parts, link)
        with Program(running.link) as program:
            assert program.answer() == RIGHT


def test_status_names_the_link_and_the_programs(running: Running) -> None:
    socket = str(running.link.parent / "control.sock")
    with Program(running.link) as program:
        assert program.answer() == RIGHT
        (panel,) = json.loads(command("status", "--json", "--control", socket).stdout)["servers"]
        assert (panel["port"], panel["programs"]) == (f"pty:{running.link}", 1)
        doctor = command("doctor", "--control", socket).stdout
        assert "one program uses pty:" in " ".join(doctor.split())


@pytest.mark.needs("mbpoll")
def test_mbpoll_again_and_again(running: Running) -> None:
    for parity in ("none", "even"):
        words = ["mbpoll", "-q", "-m", "rtu", "-b", "9600", "-P", parity, "-a", "200", "-t", "4", "-c", "2", "-1"]
        asked = subprocess.run([*words, running.link], capture_output=True, text=True, timeout=PATIENCE, check=True)
        assert asked.stdout.split()[-4:] == ["[1]:", "11", "[2]:", "22"]


@pytest.mark.needs("gcc")
@pytest.mark.skipif(not Path("/usr/include/modbus/modbus.h").exists(), reason="libmodbus-dev is not installed")
def test_an_old_program_with_libmodbus(running: Running, tmp_path: Path) -> None:
    """It closes the port and opens it again at once, as they do after an error."""
    (tmp_path / "old.c").write_text(LIBMODBUS_PROGRAM)
    program = tmp_path / "old"
    compiler = shutil.which("gcc")
    assert compiler
    subprocess.run([compiler, tmp_path / "old.c", "-I/usr/include/modbus", "-lmodbus", "-o", program], check=True)
    said = subprocess.run([program, running.link], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (said.stdout, said.stderr) == ("11 22 70\n11 22 71\n", "")


@contextmanager
def shell(script: str) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["bash", "-c", script], stdout=subprocess.PIPE) as process:
        yield process
        process.kill()


def test_a_shell(running: Running) -> None:
    request = "".join(f"\\x{byte:02x}" for byte in encode(200, READ))
    script = f"exec 3<>{running.link}; stty -F {running.link} 9600; printf '{request}' >&3; head -c {len(RIGHT)} <&3"
    with shell(script) as process:
        assert process.stdout is not None
        assert process.stdout.read() == RIGHT
