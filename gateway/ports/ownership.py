"""Who a file belongs to."""

import os
from contextlib import suppress
from pathlib import Path


def give_to_owner_of_folder(file: Path) -> None:
    """Let a file that root has made belong to whom its folder belongs to, so that a service can use it afterwards.

    For others than root there is nothing to do. A link is not followed: the folder's owner may have put it there. Where
    the system refuses, the file stays as it is.
    """
    if os.geteuid() == 0:
        with suppress(OSError):
            folder = file.parent.stat()
            os.chown(file, folder.st_uid, folder.st_gid, follow_symlinks=False)
