"""Files whose content is nobody else's business: where they are, and that nobody else may read them."""

import os
import stat
from collections.abc import Mapping
from errno import EACCES, ENOENT
from pathlib import Path

from gateway.tls.secret_file import SecretFile


def path_of(file: SecretFile, environment: Mapping[str, str] = os.environ) -> Path:
    """Where a file is; a credential is in the folder that systemd has made for the service.

    Raises:
        OSError: systemd has handed no credentials to this process.
    """
    if not file.is_credential:
        return Path(file.name)
    folder = environment.get("CREDENTIALS_DIRECTORY")
    if folder is None:
        raise OSError(ENOENT, "there is no such credential: LoadCredential= is missing in the unit", file.name)
    return Path(folder) / file.name


def refuse_if_exposed(path: Path) -> None:
    """See that only its owner may write a file, and only its owner and group may read it.

    Raises:
        OSError: others may, or there is no such file.
    """
    if path.stat().st_mode & (stat.S_IRWXO | stat.S_IWGRP):
        raise OSError(EACCES, f"others may read or change it; chmod 600 {path}", str(path))
