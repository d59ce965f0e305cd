"""The history and the last events of a gateway that runs: what outlives a power cut, a torn file and a full disk."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any
from urllib.request import urlopen

import pytest

from gateway.modbus import mbap
from gateway.observe.event_file import FILE_NAME as EVENTS_FILE_NAME
from gateway.operator.past.history import FILE_NAME
from kit import prepared, process
from kit.process import PATIENCE, GatewayProcess, command, started

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{folder}/absent"
devices = [{{ unit = 1, name = "silo" }}]

[web]
bind = "http://127.0.0.1:0"
history = {history}
"""
#: What kit/prepared.py runs, for gateways that look and write so often that a test need not wait for a minute, and
#: which a busy machine does not hurry at the end.
QUICK = f"""
import sys
sys.path.append({str(Path(prepared.__file__).parents[1])!r})
from gateway.operator.past import history
from gateway.state import row_file
history.LOOK_EVERY, row_file.WRITE_EVERY, row_file.CLOSING_DEADLINE = 0.2, 0.4, 30.0
from kit.prepared import prepare
prepare(sys.argv[1])
"""


class Gateway(GatewayProcess):
    """A gateway whose silo cannot be reached."""

    def __init__(self, folder: Path, history: str = "true") -> None:
        super().__init__(folder, CONFIG.format(folder=folder, history=history))

    def ask(self, count: int) -> None:
        with socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE) as client:
            for _ in range(count):
                client.sendall(mbap.encode(1, 1, bytes.fromhex("03 0000 0001")))
                assert client.recv(260)[7:] == bytes.fromhex("83 0A")

    def get(self, path: str) -> Any:
        (address,) = (event["address"] for event in self.log if event["event"] == "web_up")
        with urlopen(address + path, timeout=PATIENCE) as response:
            return response.read().decode()

    @property
    def not_sent(self) -> int:
        """What the history has of the silo."""
        return sum(slot["not_sent"] for slot in json.loads(self.get("/api/v1/units/silo/history"))["slots"])

    def tells(self, name: str) -> bool:
        """Whether there is such an event about the file of the history."""
        return any(Path(event["file"]).name == FILE_NAME for event in self.named(name))

    def named(self, name: str) -> list[dict[str, Any]]:
        return [event for event in self.log if event["event"] == name]


@pytest.fixture(scope="module", autouse=True)
def _gateways_are_quick(testrun_uid: str) -> Iterator[None]:
    """They are forked off a process of their own."""
    name = f"quick {testrun_uid} {os.getpid()}"
    words = [sys.executable, "-P", "-c", QUICK, f"prepared {name}"]
    subprocess.run(words, stdin=subprocess.DEVNULL, timeout=PATIENCE, check=True)
    with process.prepared(name):
        yield


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "state"
    monkeypatch.setenv("STATE_DIRECTORY", str(folder))
    return folder


def log_of(state: Path) -> Path:
    """Where the database writes first: at each look something has changed."""
    return state / f"{FILE_NAME}-wal"


def has_begun(state: Path) -> bool:
    """Whether anything was written; a gateway that ends before that keeps nothing."""
    return log_of(state).exists() and b'{"lines":{"hall":' in log_of(state).read_bytes()


def until(is_so: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_what_was_written_outlives_the_process(tmp_path: Path, state: Path, end: signal.Signals) -> None:
    for runs in range(3):
        with Gateway(tmp_path) as gateway:
            until(lambda gateway=gateway, runs=runs: gateway.not_sent == 5 * runs)
            until(lambda: has_begun(state))
            gateway.ask(5)
            if end is signal.SIGKILL:
                until(lambda gateway=gateway, runs=runs: gateway.not_sent == 5 * runs + 5)
                seen_at = time.time()
                until(lambda seen_at=seen_at: log_of(state).stat().st_mtime > seen_at + 1)
            gateway.signal(end)
            gateway.wait()
            assert not [*gateway.named("state_damaged"), *gateway.named("state_not_kept")]
            assert gateway.named("part_failed") == []


def test_a_torn_file_is_set_aside_and_the_pages_go_on(tmp_path: Path, state: Path) -> None:
    with Gateway(tmp_path) as gateway:
        gateway.ask(5)
        until(lambda: gateway.not_sent == 5)
        until(lambda: has_begun(state))
        gateway.stop()
    file = state / FILE_NAME
    file.write_bytes(file.read_bytes()[:5000])
    with Gateway(tmp_path) as gateway:
        until(lambda: gateway.named("state_damaged"))
        gateway.ask(3)
        until(lambda: gateway.not_sent >= 3)
        assert "silo" in gateway.get("/")
        until(lambda: has_begun(state))
        gateway.stop()
    aside = [path.name for path in state.iterdir() if path.name.startswith(FILE_NAME + ".")]
    assert len([name for name in aside if not name.endswith(("-wal", "-shm"))]) == 1
    with Gateway(tmp_path) as gateway:
        until(lambda: gateway.not_sent >= 3)


def test_without_history_there_is_no_file(tmp_path: Path, state: Path) -> None:
    with Gateway(tmp_path, history="false") as gateway:
        gateway.ask(5)
        until(lambda: gateway.not_sent == 5)
        time.sleep(1.0)
    assert not list(state.glob(FILE_NAME + "*"))


@pytest.fixture
def small_disk(state: Path) -> Iterator[Path]:
    """The state folder on a disk of 256 KiB."""
    state.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", state]
    if os.geteuid() or subprocess.run(mount, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    yield state
    subprocess.run(["umount", state], check=True)


def test_a_full_disk_is_told_once_and_costs_nothing_else(tmp_path: Path, small_disk: Path) -> None:
    with Gateway(tmp_path) as gateway:
        gateway.ask(1)
        until(lambda: gateway.not_sent == 1)
        ballast = small_disk / "ballast"
        with ballast.open("wb", buffering=0) as stream, suppress(OSError):
            while stream.write(bytes(4096)):
                pass
        gateway.ask(4)
        until(lambda: (gateway.ask(1), gateway.tells("state_not_kept"))[1])
        time.sleep(2.0)
        files = [event["file"] for event in gateway.named("state_not_kept")]
        assert len(files) == len(set(files))
        ballast.unlink()
        until(lambda: gateway.tells("state_kept_again"))
        until(lambda: gateway.not_sent >= 6)
        kept = gateway.not_sent
    with Gateway(tmp_path) as gateway:
        until(lambda: gateway.not_sent == kept)


def told(gateway: Gateway) -> list[str]:
    """The names of the last events."""
    answer = command("events", "--json", "--since", "1h", "--control", str(gateway.config.parent / "control.sock"))
    assert answer.returncode == 0, answer.stderr
    return [json.loads(line)["event"] for line in answer.stdout.splitlines()]


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_the_last_events_outlive_the_process(tmp_path: Path, state: Path, end: signal.Signals) -> None:
    log = state / f"{EVENTS_FILE_NAME}-wal"
    with Gateway(tmp_path) as gateway:
        until(lambda: log.exists() and b'"name":"line_lost"' in log.read_bytes())
        gateway.signal(end)
        gateway.wait()
    with Gateway(tmp_path) as gateway:
        until(lambda: told(gateway).count("config_loaded") == 2)
        assert told(gateway).count("line_lost") == 2
        assert ("stopped" in told(gateway)) == (end is signal.SIGTERM)
        line_lost = json.loads(gateway.get("/api/v1/events/last?level=warning&line=hall&count=1"))["events"]
        assert line_lost[0]["event"] == "line_lost"
        assert gateway.named("state_damaged") == gateway.named("part_failed") == []


def test_following_goes_on_over_a_reload_and_ends_with_the_gateway(tmp_path: Path) -> None:
    with Gateway(tmp_path) as gateway, TemporaryFile() as out, TemporaryFile() as err:
        words = ["events", "-f", "--control", str(tmp_path / "control.sock")]
        follower = started(words, stdout=out.fileno(), stderr=err.fileno())

        def said(file: Any) -> str:
            return os.pread(file.fileno(), 100_000, 0).decode()

        try:
            until(lambda: "ready" in said(out))
            gateway.signal(signal.SIGHUP)
            until(lambda: "config_applied" in said(out))
            gateway.config.write_text(gateway.config.read_text() + "nonsense")
            gateway.signal(signal.SIGHUP)
            until(lambda: "config_rejected" in said(out))
            gateway.stop()
            assert follower.wait(PATIENCE) == 0
        finally:
            follower.kill()
        assert said(err) == "the gateway has stopped\n"
