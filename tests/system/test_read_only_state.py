"""A state folder in which nothing can be written or read: the gateway runs, and says so."""

import json
import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from gateway.images.drivers.saved import LOG
from gateway.modbus import mbap
from kit.process import PATIENCE, GatewayProcess, command

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{folder}/absent"
devices = [{{ unit = 1, name = "silo" }}]

[[image]]
unit    = 200
name    = "always"
holding = 10
persist = "always"

[[image]]
unit    = 201
name    = "interval"
holding = 10
persist = "interval"

[[image]]
unit    = 202
name    = "never"
holding = 10

[web]
bind = "http://127.0.0.1:0"
"""
KEPT, PLAIN = (200, 201), 202


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "state"
    folder.mkdir()
    monkeypatch.setenv("STATE_DIRECTORY", str(folder))
    return folder


@pytest.fixture
def disk(state: Path) -> Iterator[Callable[[str], None]]:
    """Remount the file system of the state folder: `ro` or `rw`."""
    if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "tmpfs", state], check=False).returncode:
        pytest.skip("only root may mount a file system")

    def remount(how: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{how}", state], check=True)

    yield remount
    subprocess.run(["umount", state], check=True)


class Gateway(GatewayProcess):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder, CONFIG.format(folder=folder))

    def ask(self, unit: int, pdu: str) -> str:
        with closing(socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE)) as client:
            client.sendall(mbap.encode(1, unit, bytes.fromhex(pdu)))
            return client.recv(260)[7:].hex(" ").upper()

    def told(self, name: str) -> dict[str, str]:
        return {event["file"]: event.get("reason", "") for event in self.log if event["event"] == name}

    def command(self, *words: str) -> str:
        return command(*words, "--control", str(self.config.parent / "control.sock")).stdout


def write(value: int) -> str:
    return f"06 00 00 00 {value:02X}"


def test_on_a_read_only_file_system_everything_runs_that_needs_no_disk(
    tmp_path: Path, state: Path, disk: Callable[[str], None]
) -> None:
    with Gateway(tmp_path) as gateway:
        assert [gateway.ask(unit, write(7)) for unit in (*KEPT, PLAIN)] == 3 * [write(7)]
        gateway.stop()
    disk("ro")
    with Gateway(tmp_path) as gateway:
        assert [gateway.ask(unit, "03 0000 0001") for unit in KEPT] == 2 * ["03 02 00 07"]
        assert [gateway.ask(unit, write(8)) for unit in (*KEPT, PLAIN)] == ["86 04", "86 04", write(8)]
        assert [gateway.ask(unit, "03 0000 0001") for unit in KEPT] == 2 * ["03 02 00 07"]
        files = [str(state), str(state / LOG)]
        while str(state / "history.sqlite") not in gateway.told("state_not_kept"):
            gateway.wait_for("state_not_kept")
        told = gateway.told("state_not_kept")
        assert [told[file] for file in files] == 2 * ["Read-only file system"]
        shown = json.loads(gateway.command("status", "--json"))["state_files"]
        assert {row["file"]: row["reason"] for row in shown} == told
        assert {row["state"] for row in shown} == {"not written"}
        assert all(file in gateway.command("status") for file in files)
        rows = json.loads(gateway.command("doctor", "--passive", "--json"))["findings"]
        (row,) = (row for row in rows if row["what"] == f"{state / LOG} cannot be written: Read-only file system")
        assert row["level"] == "fix"

        disk("rw")
        assert [gateway.ask(unit, write(9)) for unit in KEPT] == [write(9), write(9)]
        gateway.wait_for("state_kept_again")
        assert str(state / LOG) not in gateway.command("status")
        assert gateway.stop() == 0
        assert gateway.rest == []
    with Gateway(tmp_path) as gateway:
        assert [gateway.ask(unit, "03 0000 0001") for unit in KEPT] == 2 * ["03 02 00 09"]


def test_on_a_file_system_that_was_never_written_it_runs_too(
    tmp_path: Path, state: Path, disk: Callable[[str], None]
) -> None:
    disk("ro")
    with Gateway(tmp_path) as gateway:
        assert [gateway.ask(unit, write(8)) for unit in (*KEPT, PLAIN)] == ["86 04", "86 04", write(8)]
        assert [gateway.ask(unit, "03 0000 0001") for unit in KEPT] == 2 * ["03 02 00 00"]
        assert gateway.stop() == 0
    assert list(state.iterdir()) == []


@pytest.mark.parametrize("name", [LOG, "images.snapshot"])
def test_of_what_cannot_be_read_no_value_is_told(tmp_path: Path, state: Path, name: str) -> None:
    """Those at the start of the config would be wrong."""
    with Gateway(tmp_path) as gateway:
        gateway.ask(200, write(7))
        gateway.stop()
    (state / name).rename(tmp_path / "elsewhere")
    (state / name).symlink_to(tmp_path / "elsewhere")
    with Gateway(tmp_path) as gateway:
        reason = f"{state / name} is a symbolic link, which is not followed; remove it"
        assert gateway.told("state_not_kept")[str(state / LOG)] == reason
        assert [gateway.ask(unit, "03 0000 0001") for unit in (*KEPT, PLAIN)] == ["83 04", "83 04", "03 02 00 00"]
        assert [gateway.ask(unit, write(8)) for unit in (*KEPT, PLAIN)] == ["86 04", "86 04", write(8)]
        (state / name).unlink()
        (tmp_path / "elsewhere").rename(state / name)
        gateway.command("reload")
        assert gateway.ask(200, "03 0000 0001") == "03 02 00 07", "a reload tries again"
        assert gateway.ask(200, write(9)) == write(9)


@pytest.mark.parametrize("is_nowhere", [True, False])
@pytest.mark.parametrize("file", ["addresses.json", "late.json", "home-assistant.json", "history.sqlite"])
def test_no_state_file_follows_a_link(tmp_path: Path, state: Path, file: str, is_nowhere: bool) -> None:
    precious = tmp_path / "precious"
    if not is_nowhere:
        precious.write_text("not to be touched")
    (state / file).symlink_to(precious)
    with Gateway(tmp_path) as gateway:
        deadline = time.monotonic() + PATIENCE
        while not (told := gateway.told("state_not_kept") | gateway.told("state_damaged")):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert list(told) == [str(state / file)]
        assert gateway.stop() == 0
    assert precious.exists() == (not is_nowhere)
    assert is_nowhere or precious.read_text() == "not to be touched"
