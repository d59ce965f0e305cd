"""Who the files belong to that root makes for a service."""

import os
from pathlib import Path

import pytest

from gateway.state.files import give_to_owner_of_folder

SOMEBODY = 4711


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make files for others")
def test_a_link_that_the_folders_owner_has_put_there_gives_nothing_else_away(tmp_path: Path) -> None:
    folder, secret = tmp_path / "state", tmp_path / "secret"
    folder.mkdir()
    os.chown(folder, SOMEBODY, SOMEBODY)
    secret.touch()
    link = folder / "late.lock"
    link.symlink_to(secret)
    give_to_owner_of_folder(link)
    assert secret.stat().st_uid == 0
    assert link.lstat().st_uid == SOMEBODY
