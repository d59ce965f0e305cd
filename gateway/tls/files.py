"""Files with secrets: where they are, and a check that no other user can read them."""

import os
import stat
from collections.abc import Mapping
from errno import EACCES, EFBIG, EINVAL, ENOENT
from pathlib import Path

from gateway.tls.settings import SecretFile


def find_path(file: SecretFile, environment: Mapping[str, str] = os.environ) -> Path:
    """Find where a file is; a credential is in the folder that systemd has made for the service.

    Raises:
        OSError: systemd has handed no credentials to this process.
    """
    if not file.is_credential:
        return Path(file.name)
    folder = environment.get("CREDENTIALS_DIRECTORY")
    if folder is None:
        raise OSError(ENOENT, "there is no such credential: LoadCredential= is missing in the unit", file.name)
    return Path(folder) / file.name


def read_whole(path: Path, most: int) -> bytes:
    """Read a regular file. Anything else, such as a pipe, could keep its reader waiting for ever.

    Raises:
        OSError: it is none, has more than `most` bytes, or cannot be read.
    """
    refuse_if_no_file(path)
    with path.open("rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise OSError(EFBIG, f"has more than {most} bytes", str(path))
    return content


def refuse_if_no_file(path: Path) -> None:
    """See that it is a regular file.

    Raises:
        OSError: it is something else, or there is none.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(EINVAL, "is not a regular file", str(path))


def refuse_if_exposed(path: Path) -> None:
    """See that only its owner may write a file, and only its owner and group may read it.

    Raises:
        OSError: others may, or there is no such file.
    """
    if path.stat().st_mode & (stat.S_IRWXO | stat.S_IWGRP):
        raise OSError(EACCES, f"others may read or change it; chmod o=,g-w {path}", str(path))
