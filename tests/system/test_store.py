"""Persistent images on a real disk: what outlives the process, and what a bad disk or a bad file does."""

import os
import signal
import socket
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from gateway.errors import StateError
from gateway.events import StateDamaged
from gateway.images.database import FILE_NAME, Item, open_database
from gateway.images.store import INTERVAL
from gateway.modbus import mbap
from gateway.modbus.codes import Area
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
SOMEBODY = 61_184
ITEMS = [Item("shift-data", Area.HOLDING, address, 1000 + address) for address in range(500)]


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
    assert f"{state / FILE_NAME}: database is locked; is another modbus-gateway running?" in second.stderr
    assert "Traceback" not in second.stderr


def test_an_image_that_is_not_kept_needs_no_file(tmp_path: Path, state: Path) -> None:
    assert asked(tmp_path, "never", "06 0000 0007") == ["06 00 00 00 07"]
    assert not (state / FILE_NAME).exists()


# --- damage ----------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a database of 500 items."""
    folder = tmp_path / "folder"
    database = open_database(folder).database
    database.write(ITEMS)
    database.close()
    return folder


def test_a_good_file_is_read_as_it_was_written(folder: Path) -> None:
    database, items, damage = open_database(folder)
    database.close()
    assert (sorted(items), damage) == (ITEMS, "")


def spoilt(folder: Path) -> tuple[list[Item], str]:
    """Open a spoilt file: what could be read, and what was said. A second opening finds all of that, and no damage."""
    database, items, damage = open_database(folder)
    database.close()
    database, again, damage_again = open_database(folder)
    database.close()
    assert (sorted(again), damage_again) == (sorted(items), "")
    return sorted(items), damage


def test_a_value_that_has_changed_by_itself_is_not_believed(folder: Path) -> None:
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        connection.execute("UPDATE items SET value = 7 WHERE address = 3")
    items, damage = spoilt(folder)
    assert items == [item for item in ITEMS if item.address != 3]
    assert damage.startswith(f"1 values have a wrong checksum; it is now {folder / FILE_NAME}.")
    assert damage.endswith("; 499 values of it could be read")


def test_any_bit_that_turns_is_noticed_or_harmless(folder: Path) -> None:
    good = (folder / FILE_NAME).read_bytes()
    for at in range(0, len(good), 97):
        spoil = bytearray(good)
        spoil[at] ^= 1 << at % 8
        _only(folder, bytes(spoil))
        database, items, damage = open_database(folder)
        database.close()
        assert set(items) <= set(ITEMS)
        assert damage or len(items) == len(ITEMS)


@pytest.mark.parametrize("step", [13, pytest.param(1, marks=pytest.mark.search)])
def test_any_bit_that_turns_in_the_names_of_the_columns_is_noticed_or_harmless(folder: Path, step: int) -> None:
    """SQLite then says that there is no such column, or tells a name that is no text."""
    good = (folder / FILE_NAME).read_bytes()
    begin = good.index(b"CREATE TABLE")
    for bit in range(8 * begin, 8 * good.index(b"WITHOUT ROWID", begin), step):
        spoil = bytearray(good)
        spoil[bit // 8] ^= 1 << bit % 8
        _only(folder, bytes(spoil))
        database, items, damage = open_database(folder)
        database.close()
        assert set(items) <= set(ITEMS)
        assert damage or len(items) == len(ITEMS)
        assert not damage or bytes(spoil) in [path.read_bytes() for path in folder.iterdir()]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_a_torn_file_is_set_aside(folder: Path, share: float) -> None:
    good = (folder / FILE_NAME).read_bytes()
    torn = good[: int(share * len(good))]
    _only(folder, torn)
    items, damage = spoilt(folder)
    assert set(items) <= set(ITEMS)
    assert damage
    assert torn in [path.read_bytes() for path in folder.iterdir()]


@pytest.mark.parametrize("content", [b"not a database\n" * 1000, b"\0" * 8192])
def test_a_foreign_file_is_set_aside(folder: Path, content: bytes) -> None:
    _only(folder, content)
    items, damage = spoilt(folder)
    assert (items, bool(damage)) == ([], True)
    assert content in [path.read_bytes() for path in folder.iterdir()]


def test_a_database_of_another_program_is_set_aside(folder: Path) -> None:
    (folder / FILE_NAME).unlink()
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        connection.execute("CREATE TABLE items (name TEXT)")
    before = (folder / FILE_NAME).read_bytes()
    assert spoilt(folder)[1].startswith("it is a database of another program")
    assert before in [path.read_bytes() for path in folder.iterdir()]


def test_a_database_of_another_program_is_set_aside_with_its_log_as_they_are(folder: Path, tmp_path: Path) -> None:
    """As that program has left them when it was killed: its last transactions are in the log only."""
    theirs = tmp_path / "theirs.sqlite"
    with closing(sqlite3.connect(theirs, isolation_level=None)) as connection:
        connection.executescript("PRAGMA journal_mode = WAL; CREATE TABLE items (name TEXT)")
        before = [Path(f"{theirs}{part}").read_bytes() for part in ("", "-wal")]
    _only(folder, before[0])
    (folder / f"{FILE_NAME}-wal").write_bytes(before[1])
    assert spoilt(folder)[1].startswith("it is a database of another program")
    (aside,) = (path for path in folder.iterdir() if path.suffix.removeprefix(".").replace("-", "").isdecimal())
    assert [Path(f"{aside}{part}").read_bytes() for part in ("", "-wal")] == before
    with closing(sqlite3.connect(aside)) as connection:
        assert connection.execute("SELECT count(*) FROM items").fetchone() == (0,)


def test_a_file_from_a_later_version_is_left_alone(folder: Path) -> None:
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        connection.execute("PRAGMA user_version = 2")
    with pytest.raises(StateError, match="written by a later version"):
        open_database(folder)
    assert [path.name for path in folder.iterdir()] == [FILE_NAME]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match="images that persist need a folder to write in"):
        open_database(tmp_path / "file" / "state")


@pytest.mark.parametrize("code", ["SQLITE_CANTOPEN", "SQLITE_READONLY_DIRECTORY"])
def test_a_folder_in_which_nothing_can_be_written_is_not_another_gateway(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    """A file system that is mounted for reading only refuses root too."""

    def refuse(*_: object, **__: object) -> None:
        error = sqlite3.OperationalError("unable to open database file")
        error.sqlite_errorcode = getattr(sqlite3, code)
        raise error

    monkeypatch.setattr(sqlite3, "connect", refuse)
    with pytest.raises(StateError, match="unable to open database file; images that persist need a folder to write in"):
        open_database(tmp_path)


only_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else")


@only_root
def test_what_root_has_made_in_somebody_elses_folder_can_be_used_by_them(folder: Path) -> None:
    os.chown(folder, SOMEBODY, SOMEBODY)
    with closing(open_database(folder).database) as database:
        database.write(ITEMS)
        assert {file.stat().st_uid for file in folder.iterdir()} == {SOMEBODY}


@only_root
def test_a_file_of_somebody_else_is_said_to_lack_the_permission() -> None:
    with TemporaryDirectory() as name:  # that of pytest lets nobody else in
        folder, file = Path(name), Path(name, FILE_NAME)
        open_database(folder).database.close()
        os.chown(folder, SOMEBODY, SOMEBODY)
        os.seteuid(SOMEBODY)
        try:
            with pytest.raises(StateError) as refusal:
                open_database(folder)
        finally:
            os.seteuid(0)
        advice = f"as root: chown --reference={folder} {file}"
        assert str(refusal.value) == f"{file}: no permission to read and write it; {advice}"


def test_damage_is_told_and_the_rest_serves(tmp_path: Path, state: Path) -> None:
    asked(tmp_path, "always", "06 0000 0007", "06 0001 0008")
    with closing(sqlite3.connect(state / FILE_NAME)) as connection, connection:
        connection.execute("UPDATE items SET value = 9 WHERE address = 0")
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")) as gateway, closing(Client(gateway)) as client:
        assert client.ask("03 0000 0002") == "03 04 00 01 00 08"
        assert StateDamaged.name in [event["event"] for event in gateway.log]


def _only(folder: Path, content: bytes) -> None:
    """Make the database the only file, with this content."""
    for path in folder.iterdir():
        path.unlink()
    (folder / FILE_NAME).write_bytes(content)


# --- a full disk -----------------------------------------------------------------------------------


@pytest.fixture
def small_disk(state: Path) -> Iterator[Path]:
    """The state folder on a disk of 256 KiB."""
    state.mkdir()
    if (
        os.geteuid()
        or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", state], check=False).returncode
    ):
        pytest.skip("only root may mount a small disk")
    yield state
    subprocess.run(["umount", state], check=True)


def test_a_full_disk_refuses_writes_and_loses_none_that_was_acknowledged(tmp_path: Path, small_disk: Path) -> None:
    with GatewayProcess(tmp_path, CONFIG.format(persist="always")) as gateway, closing(Client(gateway)) as client:
        assert client.ask("06 0000 0007") == "06 00 00 00 07"
        ballast = small_disk / "ballast"
        _fill_up(ballast)
        refused = [client.ask(f"06 0000 {value:04X}") for value in range(8, 108)]
        acknowledged = [value for value, answer in enumerate(refused, 8) if answer != "86 04"]
        assert refused[-1] == "86 04"
        assert client.ask("03 0000 0001") == f"03 02 00 {max([7, *acknowledged]):02X}"
        ballast.unlink()
        assert client.ask("06 0000 0009") == "06 00 00 00 09"
        gateway.wait_for("state_kept_again")
        gateway.signal(signal.SIGKILL)
        gateway.wait()
        assert [event["event"] for event in gateway.log].count("state_not_kept") == 1
    assert asked(tmp_path, "always", "03 0000 0001") == ["03 02 00 09"]


def _fill_up(ballast: Path) -> None:
    """Let this file take all the room there is."""
    with ballast.open("wb", buffering=0) as stream, suppress(OSError):
        while stream.write(bytes(4096)):
            pass
