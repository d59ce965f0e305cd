"""The owner of files."""

import os
from contextlib import suppress
from pathlib import Path


def give_to_owner_of_folder(file: Path) -> None:
    """Give a file that root has created to the owner of its folder, so that a service can use it afterwards.

    Does nothing for other users, or if the system does not allow it. A link is not followed: the folder's owner may
    have created it.
    """
    if os.geteuid() == 0:
        with suppress(OSError):
            folder = file.parent.stat()
            os.chown(file, folder.st_uid, folder.st_gid, follow_symlinks=False)
