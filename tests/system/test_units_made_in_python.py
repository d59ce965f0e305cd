"""Units made in Python in a gateway that runs as an operator starts it."""

import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode
from kit.process import PATIENCE, GatewayProcess, command, simulated

UNITS = """\
import asyncio
import time
from gateway import CustomUnit, IllegalAddress


class Clock(CustomUnit):
    async def read(self, area, address, count):
        if address + count > 10:
            raise IllegalAddress("it has ten registers")
        return [7] * count


class Sleeper(CustomUnit):
    async def read(self, area, address, count):
        time.sleep(60)


class Computing(CustomUnit):
    async def read(self, area, address, count):
        end = time.monotonic() + 5
        while time.monotonic() < end:
            pass


class Sum(CustomUnit):
    async def read(self, area, address, count):
        both = await asyncio.gather(self.unit("meter-1").read_holding(0), self.unit(62).read_holding(0))
        return [sum(each[0] for each in both)] * count


class Kept(CustomUnit):
    value = 0

    async def read(self, area, address, count):
        return [self.value] * count

    async def write(self, area, address, values):
        self.value = values[0]
"""
LISTENER = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n'
CLOCK = '[[image]]\nunit = 60\nname = "clock"\npython = "units_of_test:Clock"\n'
READ = bytes.fromhex("0300000001")
RESTS = "unit_resting"


def write_units(folder: Path, text: str = UNITS) -> None:
    (folder / "units_of_test.py").write_text(text)


@contextmanager
def running(folder: Path, config: str) -> Iterator[GatewayProcess]:
    write_units(folder)
    control = folder / "control.sock"
    with GatewayProcess(folder, f'{LISTENER}{config}[control]\nsocket = "{control}"\n') as gateway:
        yield gateway


def asks(gateway: GatewayProcess, unit: int, pdu: bytes = READ) -> str:
    with socket.create_connection(("127.0.0.1", gateway.port), PATIENCE) as client:
        client.sendall(encode(1, unit, pdu))
        return client.recv(260)[7:].hex()


def takes(gateway: GatewayProcess, unit: int) -> tuple[str, float]:
    """An answer, and how long it took in seconds."""
    began = time.monotonic()
    return asks(gateway, unit), time.monotonic() - began


def change(gateway: GatewayProcess, old: str, new: str) -> None:
    text = gateway.config.read_text()
    assert old in text
    gateway.config.write_text(text.replace(old, new, 1))


def reloaded(gateway: GatewayProcess) -> dict:
    gateway.signal(signal.SIGHUP)
    return gateway.wait_for("config_applied")


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """When the watchdog was told of a sign of life; its period is 3 s."""
    signs: list[float] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.settimeout(0.1)
        is_over = threading.Event()

        def listen() -> None:
            while not is_over.is_set():
                with suppress(TimeoutError):
                    if sock.recv(8192) == b"WATCHDOG=1":
                        signs.append(time.monotonic())

        monkeypatch.setenv("NOTIFY_SOCKET", sock.getsockname())
        monkeypatch.setenv("WATCHDOG_USEC", "3000000")
        listener = threading.Thread(target=listen)
        listener.start()
        yield signs
        is_over.set()
        listener.join()


@pytest.mark.parametrize("kind", ["Sleeper", "Computing"])
def test_one_that_blocks_stops_no_line_and_no_watchdog(tmp_path: Path, systemd: list[float], kind: str) -> None:
    port = tmp_path / "hall"
    config = f"""
[[line]]
name = "hall"
port = "{port}"
devices = [{{ unit = 1, as = 41, name = "silo-1", profile = "weigher", timeout = "20 s" }}]

[[image]]
unit = 64
name = "blocks"
python = "units_of_test:{kind}"
"""
    with simulated(port, "weigher:1"), running(tmp_path, config + CLOCK) as gateway:
        assert asks(gateway, 60) == "03020007"
        right = asks(gateway, 41)
        assert right[:2] == "03"
        began = time.monotonic()
        answers: list[tuple[str, float]] = []
        blocked = threading.Thread(target=lambda: answers.extend(takes(gateway, 64) for _ in range(3)))
        blocked.start()
        on_line = []
        while blocked.is_alive():
            on_line.append(takes(gateway, 41))
        blocked.join()
        first, *others = (answer for answer, _ in answers)
        assert first == "830b"
        assert {*others} <= {"8306", "830b"}, "it waited for the first call, or the unit rests already"
        assert 0.9 < answers[0][1] < 10  # and not 60: the machine may be busy
        gateway.first(RESTS)
        assert {answer for answer, _ in on_line} == {right}
        assert max(elapsed for _, elapsed in on_line) < 5
        signs = [at for at in systemd if at > began]
        assert len(signs) >= 2
        assert max(later - one for one, later in pairwise(signs)) < 5
        began = time.monotonic()
        assert gateway.stop() == 0
        assert time.monotonic() - began < 10


def test_one_that_reads_two_others_of_the_gateway(tmp_path: Path) -> None:
    meters = "".join(
        f'[[image]]\nunit = {unit}\nname = "{name}"\nholding = 1\n'
        f"initial.holding = [{{ at = 0, values = [{value}] }}]\n"
        for unit, name, value in ((61, "meter-1", 30), (62, "meter-2", 12))
    )
    made = '[[image]]\nunit = 63\nname = "sum"\npython = "units_of_test:Sum"\n'
    with running(tmp_path, meters + made) as gateway:
        assert asks(gateway, 63) == "0302002a"
        asks(gateway, 61, bytes.fromhex("0600000064"))
        assert asks(gateway, 63) == "03020070"


def test_a_reload_brings_changes_and_removes_one(tmp_path: Path) -> None:
    image = "[[image]]\nunit = 1\ncoils = 1\n"
    with running(tmp_path, image) as gateway:
        change(gateway, image, image + CLOCK)
        assert reloaded(gateway)["added"] == ["image clock"]
        assert asks(gateway, 60) == "03020007"
        assert asks(gateway, 60, bytes.fromhex("0300090002")) == "8302"
        change(gateway, "Clock", "Kept")
        assert reloaded(gateway)["changed"] == ["image clock"]
        assert asks(gateway, 60, bytes.fromhex("0600000005")) == "0600000005"
        assert reloaded(gateway)["changed"] == []
        assert asks(gateway, 60) == "03020005"  # it is the same object
        change(gateway, CLOCK.replace("Clock", "Kept"), "")
        assert reloaded(gateway)["removed"] == ["image clock"]
        assert asks(gateway, 60) == "830a"


def test_a_reload_that_brings_what_cannot_run_changes_nothing(tmp_path: Path) -> None:
    with running(tmp_path, CLOCK) as gateway:
        (tmp_path / "broken.py").write_text("raise ValueError('no sensor')\n")
        change(gateway, CLOCK, f'{CLOCK}[[image]]\nunit = 61\nname = "other"\npython = "broken:Clock"\n')
        done = command("reload", "--config", str(gateway.config))
        assert done.returncode == 1
        assert f"broken cannot be imported: ValueError: no sensor ({tmp_path}/broken.py, line 1)" in done.stdout
        (tmp_path / "broken.py").write_text(UNITS.replace("class Clock(CustomUnit):", CANNOT_BE_MADE))
        done = command("reload", "--config", str(gateway.config))
        assert done.returncode == 1
        assert f"broken:Clock cannot be made: OSError: no sensor ({tmp_path}/broken.py, line 8)" in done.stdout
        assert asks(gateway, 60) == "03020007"


CANNOT_BE_MADE = """\
class Clock(CustomUnit):
    def __init__(self):
        raise OSError("no sensor")
"""


def test_one_that_cannot_be_made_is_why_the_gateway_does_not_start(tmp_path: Path) -> None:
    write_units(tmp_path, UNITS.replace("class Clock(CustomUnit):", CANNOT_BE_MADE))
    (tmp_path / "gateway.toml").write_text(LISTENER + CLOCK)
    assert command("check", str(tmp_path / "gateway.toml")).returncode == 0
    done = command("run", str(tmp_path / "gateway.toml"))
    assert done.returncode == 1
    assert ": image clock: units_of_test:Clock cannot be made: OSError: no sensor" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_module_that_has_changed_needs_a_restart_and_the_reload_says_so(tmp_path: Path) -> None:
    with running(tmp_path, CLOCK) as gateway:
        assert reloaded(gateway)["restart"] == []
        write_units(tmp_path, UNITS.replace("[7]", "[8]"))
        assert reloaded(gateway)["restart"] == ["image clock"]
        assert asks(gateway, 60) == "03020007"


def test_status_and_check_say_what_it_is(tmp_path: Path) -> None:
    with running(tmp_path, CLOCK) as gateway:
        asks(gateway, 60)
        status = command("status", "--config", str(gateway.config)).stdout
        assert "Units made in Python" in status
        assert "clock  units_of_test:Clock  fine   1" in status
        checked = command("check", str(gateway.config)).stdout
        assert "clock  units_of_test:Clock  1 s      generic  all" in checked


def test_a_module_that_goes_to_another_folder_does_not_take_the_config_with_it(tmp_path: Path) -> None:
    write_units(tmp_path, f"import os\nos.chdir('/')\n{UNITS}")
    gateway = GatewayProcess(tmp_path, f'{LISTENER}{CLOCK}[control]\nsocket = "{tmp_path}/control.sock"\n')
    gateway.config = Path(os.path.relpath(gateway.config))
    with gateway:
        change(gateway, CLOCK, CLOCK + CLOCK.replace("60", "61").replace('"clock"', '"other"'))
        assert reloaded(gateway)["added"] == ["image other"]
        assert asks(gateway, 61) == "03020007"
