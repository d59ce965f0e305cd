"""A database on a real disk: what damage, foreign files, links and missing permissions do."""

import os
import resource
import sqlite3
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import Mock
from zlib import crc32

import pytest

from gateway.errors import StateError
from gateway.state.database import Opened, Row, Table, open_table

FILE_NAME = "items.sqlite"
TABLE = Table(
    name="items",
    columns=(("image", "TEXT"), ("area", "TEXT"), ("address", "INTEGER"), ("value", "INTEGER")),
    keys=3,
    check_sum=lambda row: crc32(repr(row).encode()),
    application=0x4D424757,
    version=1,
    needed_by="images that persist",
)
SOMEBODY = 61_184
ITEMS = [("shift-data", "holding", address, 1000 + address) for address in range(500)]


def open_database(folder: Path) -> Opened:
    return open_table(folder / FILE_NAME, TABLE)


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


def spoilt(folder: Path) -> tuple[list[Row], str]:
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
    assert items == [item for item in ITEMS if item[2] != 3]
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


@pytest.mark.parametrize("part", ["", "-wal", "-journal"])
@pytest.mark.parametrize("has_target", [False, True])
def test_no_link_is_followed(tmp_path: Path, part: str, has_target: bool) -> None:
    precious, folder = tmp_path / "precious", tmp_path / "state"
    if has_target:
        precious.write_text("not to be touched")
    folder.mkdir()
    (folder / f"{FILE_NAME}{part}").symlink_to(precious)
    with pytest.raises(StateError, match="is a symbolic link, which is not followed; remove it"):
        open_database(folder)
    assert precious.exists() == has_target
    assert not has_target or precious.read_text() == "not to be touched"


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


def test_a_file_on_a_read_only_file_system_needs_no_other_owner(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    open_database(folder).database.close()
    (folder / FILE_NAME).chmod(0o400)
    refused = sqlite3.OperationalError("attempt to write a readonly database")
    monkeypatch.setattr("gateway.state.database._open", Mock(side_effect=refused))
    monkeypatch.setattr(os, "statvfs", lambda _: Mock(f_flag=os.ST_RDONLY))
    with pytest.raises(StateError) as refusal:
        open_database(folder)
    assert str(refusal.value) == f"{folder / FILE_NAME}: its file system is read-only"


def _only(folder: Path, content: bytes) -> None:
    """Make the database the only file, with this content."""
    for path in folder.iterdir():
        path.unlink()
    (folder / FILE_NAME).write_bytes(content)


def test_a_database_that_a_full_disk_does_not_let_be_made_leaves_nothing(tmp_path: Path) -> None:
    whole = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, whole[1]))
    try:
        for _ in range(3):
            with pytest.raises(StateError):
                open_database(tmp_path)
        assert list(tmp_path.iterdir()) == []
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, whole)
    assert open_database(tmp_path).damage == ""
