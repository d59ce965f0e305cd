"""Files of the state folder. Symbolic links are never followed: the owner of the folder may have planted them.

All calls block.
"""

import errno
import os
import stat
from contextlib import suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO


def open_plainly(file: Path, flags: int) -> int:
    """Open a file without following a link, and return its descriptor; a new file gets the owner of the folder.

    Raises:
        OSError: it cannot be opened, or is a link.
    """
    try:
        descriptor = os.open(file, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, f"{file} is a symbolic link, which is not followed; remove it") from None
        raise
    if flags & os.O_CREAT:
        give_to_owner_of_folder(file)
    return descriptor


def read(file: Path, most: int = -1) -> bytes:
    """Read a regular file, up to `most` bytes.

    Raises:
        OSError: it cannot be read, or is not a regular file.
    """
    with open(open_plainly(file, os.O_RDONLY), "rb") as stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise OSError(errno.EINVAL, f"{file} is not a regular file")
        return stream.read(most)


def replace(file: Path, content: bytes) -> None:
    """Replace the content of the file atomically; it is on the disk when this returns.

    Raises:
        OSError: it cannot be written.
    """
    fresh = file.with_name(f"{file.name}.new")
    fresh.unlink(missing_ok=True)
    with open(open_plainly(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    fresh.replace(file)
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def lock(file: Path) -> IO[bytes]:
    """Lock `file` against other processes until what is returned is closed; make it and its folder where needed.

    Raises:
        BlockingIOError: another process holds the lock.
        OSError: it cannot be opened for writing.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    stream = open(open_plainly(file, os.O_WRONLY | os.O_CREAT), "wb")  # noqa: SIM115 - the holder of the lock closes it
    try:
        flock(stream, LOCK_EX | LOCK_NB)
    except BaseException:
        stream.close()
        raise
    return stream


def give_to_owner_of_folder(file: Path) -> None:
    """Give a file that root has created to the owner of its folder, so that a service can use it afterwards.

    Does nothing for other users, or if the system does not allow it. A link is not followed: the folder's owner may
    have created it.
    """
    if os.geteuid() == 0:
        with suppress(OSError):
            folder = file.parent.stat()
            os.chown(file, folder.st_uid, folder.st_gid, follow_symlinks=False)
