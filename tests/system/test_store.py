"""Persistent images on a real disk: what outlives the process, and what a bad disk or a bad file does."""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

from gateway.images.drivers.saved import LOG, open_saved
from gateway.images.drivers.store import INTERVAL
from gateway.modbus import mbap
from gateway.modbus.codes import Area
from gateway.state.page_log import SIZE
from kit.process import PATIENCE, GatewayProcess, command

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit    = 200
name    = "shift-data"
holding = 100
coils   = 16
persist = "{persist}"
initial.holding = [{{ at = 0, values = [1, 2, 3] }}]
"""


class Client:
    """Asks image 200 over TCP, one request at a time."""

    def __init__(self, gateway: GatewayProcess) -> None:
        self._socket = socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE)

    def ask(self, pdu: str) -> str:
        self._socket.sendall(mbap.encode(1, 200, bytes.fromhex(pdu)))
        return self._socket.recv(260)[7:].hex(" ").upper()

    def close(self) -> None:
        self._socket.close()


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "state"
    monkeypatch.setenv("STATE_DIRECTORY", str(folder))
    return folder


def asked(tmp_path: Path, persist: str, *pdus: str, end: signal.Signals = signal.SIGTERM) -> list[str]:
    """What a gateway answers in one run that ends with this signal."""
    with GatewayProcess(tmp_path, CONFIG.format(persist=persist)) as gateway:
        with closing(Client(gateway)) as client:
            answers = [client.ask(pdu) for pdu in pdus]
        gateway.signal(end)
        gateway.wait()
    return answers


def test_what_was_acknowledged_outlives_kill_9(tmp_path: Path) -> None:
    for value in range(1, 6):
        answers = asked(tmp_path, "always", "03 0000 0002", f"06 0000 {value:04X}", "05 0003 FF00", end=signal.SIGKILL)
        assert answers == [f"03 04 00 {max(value - 1, 1):02X} 00 02", f"06 00 00 00 {value:02X}", "05 00 03 FF 00"]
    assert asked(tmp_path, "always", "01 0000 0004") == ["01 01 08"]


def test_a_write_costs_the_disk_one_block(tmp_path: Path) -> None:
    """And a snapshot for each 256 of them."""
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")) as gateway, closing(Client(gateway)) as client:
        client.ask("06 0000 0001")
        before = _written(gateway)
        for value in range(300):
            client.ask(f"06 0000 {value:04X}")
        assert _written(gateway) - before <= 310 * 4096


def _written(gateway: GatewayProcess) -> int:
    """The bytes that it has caused to be written to disks."""
    fields = dict(line.split(": ") for line in Path(f"/proc/{gateway.pid}/io").read_text().splitlines())
    return int(fields["write_bytes"])


def test_an_interval_loses_nothing_at_a_stop(tmp_path: Path) -> None:
    asked(tmp_path, "interval", "06 0000 BEEF")
    assert asked(tmp_path, "interval", "03 0000 0002") == ["03 04 BE EF 00 02"]


def test_what_was_acknowledged_is_not_overwritten_by_what_came_before_a_reload(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, CONFIG.format(persist="interval")) as gateway:
        with closing(Client(gateway)) as client:
            assert client.ask("06 0000 0007") == "06 00 00 00 07"
            gateway.config.write_text(gateway.config.read_text().replace("interval", "always"))
            gateway.signal(signal.SIGHUP)
            gateway.wait_for("config_applied")
            assert client.ask("06 0000 0008") == "06 00 00 00 08"
        time.sleep(2 * INTERVAL)
        gateway.signal(signal.SIGKILL)
        gateway.wait()
    assert asked(tmp_path, "always", "03 0000 0001") == ["03 02 00 08"]


def test_an_image_that_shrinks_and_grows_again_has_its_values(tmp_path: Path) -> None:
    asked(tmp_path, "always", "06 0032 0007")
    smaller = CONFIG.replace("holding = 100", "holding = 10").format(persist="always")
    with GatewayProcess(tmp_path, smaller) as gateway, closing(Client(gateway)) as client:
        assert client.ask("03 0032 0001") == "83 02"
    assert asked(tmp_path, "always", "03 0032 0001") == ["03 02 00 07"]


def test_nobody_else_can_use_the_file(tmp_path: Path, state: Path) -> None:
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")):
        second = command("run", str(tmp_path / "gateway.toml"))
    assert second.returncode == 1
    assert f"{state / LOG} is in use; is another modbus-gateway running?" in second.stderr
    assert "Traceback" not in second.stderr


def test_an_image_that_is_not_kept_needs_no_file(tmp_path: Path, state: Path) -> None:
    assert asked(tmp_path, "never", "06 0000 0007") == ["06 00 00 00 07"]
    assert not (state / LOG).exists()


# --- damage ----------------------------------------------------------------------------------------


@pytest.fixture
def left_behind(tmp_path: Path, state: Path) -> dict[int, int]:
    """What a gateway has acknowledged that was killed; its files are in the state folder."""
    asked(tmp_path, "always", "06 0032 0001", "06 0033 0002")
    writes = [f"06 {address:04X} {1000 + address:04X}" for address in range(20)]
    asked(tmp_path, "always", *writes, "06 0000 0007", end=signal.SIGKILL)
    return {address: 1000 + address for address in range(20)} | {0: 7, 50: 1, 51: 2}


@pytest.mark.parametrize("name", [LOG, "images.snapshot"])
def test_no_byte_of_a_file_can_change_without_a_word(state: Path, left_behind: dict[int, int], name: str) -> None:
    """All of those that were written; some of all."""
    with (state / name).open("r+b", buffering=0) as stream:
        good = (state / name).read_bytes()
        assert name != LOG or len(good) == SIZE
        for at in (*range(0, min(len(good), 22 * 4096), 229), *range(0, len(good), 50_021)):
            os.pwrite(stream.fileno(), bytes((good[at] ^ 1 << at % 8,)), at)
            opened = open_saved(state)
            opened.saved.close()
            assert opened.values == {("shift-data", Area.HOLDING): left_behind}
            assert opened.damage
            os.pwrite(stream.fileno(), good[at : at + 1], at)


def test_damage_is_told_and_the_rest_serves(tmp_path: Path, state: Path, left_behind: dict[int, int]) -> None:
    for name in (LOG, "images.snapshot"):
        content = bytearray((state / name).read_bytes())
        content[100] ^= 1
        (state / name).write_bytes(content)
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")) as gateway, closing(Client(gateway)) as client:
        (damaged,) = (event for event in gateway.log if event["event"] == "state_damaged")
        assert damaged["file"] == str(state / LOG)
        assert damaged["damage"].startswith("pages with one damaged copy, of which the other one was used: 2; ")
        assert damaged["damage"].endswith(f"; {len(left_behind)} values could be read")
        assert client.ask("03 0000 0002") == "03 04 00 07 03 E9"
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")) as gateway:
        assert "state_damaged" not in [event["event"] for event in gateway.log]


# --- a full disk -----------------------------------------------------------------------------------


@pytest.fixture
def small_disk(state: Path) -> Iterator[Path]:
    """The state folder on a disk of 1.5 MiB."""
    state.mkdir()
    if (
        os.geteuid()
        or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1536k", "tmpfs", state], check=False).returncode
    ):
        pytest.skip("only root may mount a small disk")
    yield state
    subprocess.run(["umount", state], check=True)


def test_a_full_disk_refuses_writes_and_loses_none_that_was_acknowledged(tmp_path: Path, small_disk: Path) -> None:
    """The log has its place already; when it is full, a snapshot needs more."""
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")) as gateway, closing(Client(gateway)) as client:
        assert client.ask("06 0000 0007") == "06 00 00 00 07"
        ballast = small_disk / "ballast"
        _fill_up(ballast)
        answers = [client.ask(f"06 0000 {value:04X}") for value in range(8, 308)]
        acknowledged = [value for value, answer in enumerate(answers, 8) if answer != "86 04"]
        assert acknowledged == list(range(8, 8 + 255))
        assert client.ask("03 0000 0001") == f"03 02 {acknowledged[-1] >> 8:02X} {acknowledged[-1] & 255:02X}"
        ballast.unlink()
        assert client.ask("06 0000 0009") == "06 00 00 00 09"
        gateway.wait_for("state_kept_again")
        gateway.signal(signal.SIGKILL)
        gateway.wait()
        files = [event["file"] for event in gateway.log if event["event"] == "state_not_kept"]
        assert len(files) == len(set(files))  # once for each: others are written too if that takes long
    assert asked(tmp_path, "always", "03 0000 0001") == ["03 02 00 09"]


def _fill_up(ballast: Path) -> None:
    """Let this file take all the room there is."""
    with ballast.open("wb", buffering=0) as stream, suppress(OSError):
        while stream.write(bytes(4096)):
            pass
