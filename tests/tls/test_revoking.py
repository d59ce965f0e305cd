"""Commands that change the folder of an authority at the same time, and folders of any name."""

import fcntl
import os
from functools import partial
from pathlib import Path
from threading import Barrier, Thread

import pytest

from gateway.errors import TlsError
from gateway.tls import revoking, workshop
from gateway.tls.files import read_certificates
from gateway.tls.making import make_authority, make_client
from gateway.tls.revoking import read_revoked, revoke


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_authority(tmp_path, "plant")
    return tmp_path


def test_revocations_at_the_same_time_are_all_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = [make_client(folder, name) for name in ("hmi", "spy")]
    both, read = Barrier(2, timeout=1.0), revoking.read_revoked

    def read_beside_the_other_one(where: Path) -> set[str]:
        found = read(where)
        if not both.broken:
            try:
                both.wait()
            except Exception:  # noqa: BLE001 - the other one is not here: it waits
                both.abort()
        return found

    monkeypatch.setattr(revoking, "read_revoked", read_beside_the_other_one)
    threads = [Thread(target=revoke, args=(folder, [file])) for file in files]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert read_revoked(folder) == {read_certificates(file)[0].serial for file in files}


def test_a_command_that_does_not_end_is_not_waited_for_without_end(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = make_client(folder, "hmi")
    revoke_it = partial(revoke, folder, [file])
    monkeypatch.setattr(workshop, "TURN_WITHIN", 0.1)
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        for command in (revoke_it, lambda: make_client(folder, "new"), lambda: make_authority(folder, "other")):
            with pytest.raises(TlsError, match="another command is still at work there"):
                command()
    finally:
        os.close(held)
    assert revoke_it()


@pytest.mark.parametrize("name", ["cost $x", "hall #2", "${HOME}", "back\\slash", "a=b;c'd\"e"])
def test_a_folder_may_have_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in (tmp_path / name, Path(name, "relative")):
        make_authority(folder, "plant")
        file = make_client(folder, "hmi")
        revoke(folder, [file])
        assert read_revoked(folder) == {read_certificates(file)[0].serial}
