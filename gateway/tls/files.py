"""Files of keys, certificates and other secrets: their paths, contents and permissions."""

import base64
import os
import stat
from collections.abc import Mapping
from errno import EACCES, EFBIG, EINVAL, ENOENT
from pathlib import Path
from typing import Final

from gateway.errors import TlsError
from gateway.tls.certificate import Certificate, RevocationList, parse_certificate, parse_list
from gateway.tls.settings import SecretFile

#: The largest file that is read: an authority file may have a hundred certificates.
LARGEST_FILE: Final = 1024 * 1024

_CERTIFICATE: Final = "CERTIFICATE"
_LIST: Final = "X509 CRL"
_HOW_TO_MAKE: Final = "modbus-gateway certificates makes one"


def find_path(file: SecretFile, environment: Mapping[str, str] = os.environ) -> Path:
    """Return the path of a file; a credential is in the folder that systemd has created for the service.

    Raises:
        OSError: it is a credential, and systemd has passed none to this process.
    """
    if not file.is_credential:
        return Path(file.name)
    folder = environment.get("CREDENTIALS_DIRECTORY")
    if folder is None:
        raise OSError(ENOENT, "there is no such credential: LoadCredential= is missing in the unit", file.name)
    return Path(folder) / file.name


def read_whole(path: Path, most: int) -> bytes:
    """Read a regular file. Anything else, such as a pipe, could block forever.

    Raises:
        OSError: it is not a regular file, has more than `most` bytes, or cannot be read.
    """
    refuse_if_no_file(path)
    with path.open("rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise OSError(EFBIG, f"has more than {most} bytes", str(path))
    return content


def refuse_if_no_file(path: Path) -> None:
    """Refuse anything but a regular file.

    Raises:
        OSError: it is something else, or does not exist.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(EINVAL, "is not a regular file", str(path))


def refuse_if_exposed(path: Path) -> None:
    """Refuse a file that other users may read or change, or its group may change.

    Raises:
        OSError: they may, or there is no such file.
    """
    if path.stat().st_mode & (stat.S_IRWXO | stat.S_IWGRP):
        raise OSError(EACCES, f"others may read or change it; chmod o=,g-w {path}", str(path))


def read_certificates(path: Path) -> list[Certificate]:
    """Read the certificates in a PEM file; at least one.

    Raises:
        TlsError: it cannot be read, or has none.
    """
    try:
        return [parse_certificate(block) for block in _read_blocks(SecretFile(str(path)), _CERTIFICATE)]
    except ValueError as wrong:
        raise TlsError(f"{path}: the certificate in it {wrong}") from wrong


def read_lists(file: SecretFile) -> list[RevocationList]:
    """Read the revocation lists in a PEM file; at least one.

    Raises:
        TlsError: it cannot be read, or has none.
    """
    try:
        return [parse_list(block) for block in _read_blocks(file, _LIST)]
    except ValueError as wrong:
        raise TlsError(f"{locate(file)}: the revocation list in it {wrong}") from wrong


def read(file: SecretFile) -> bytes:
    """Read a whole file.

    Raises:
        TlsError: it cannot be read, or has more than LARGEST_FILE bytes.
    """
    path = locate(file)
    try:
        return read_whole(path, LARGEST_FILE)
    except OSError as error:
        raise explain_failure(path, error) from error


def locate(file: SecretFile) -> Path:
    """Return the path of a file.

    Raises:
        TlsError: see `find_path`.
    """
    try:
        return find_path(file)
    except OSError as error:
        raise TlsError(f"{file.name}: {error.strerror}") from error


def explain_failure(path: Path, error: OSError) -> TlsError:
    """Make the error for a file that cannot be read, with a remedy."""
    remedy = f"; {_HOW_TO_MAKE}" if isinstance(error, FileNotFoundError) else ""
    reason = error.strerror or str(error)
    return TlsError(f"{path}: {reason[:1].lower()}{reason[1:]}{remedy}")


def _read_blocks(file: SecretFile, kind: str) -> list[bytes]:
    """Read the DER of each block of this kind in a PEM file; at least one."""
    parts = read(file).decode("ascii", errors="replace").split(f"-----BEGIN {kind}-----")[1:]
    if not parts:
        raise TlsError(f"{locate(file)}: has no {kind} in PEM form; {_HOW_TO_MAKE}")
    return [_decode(file, part.partition(f"-----END {kind}-----")[0]) for part in parts]


def _decode(file: SecretFile, body: str) -> bytes:
    try:
        return base64.decodebytes(body.encode("ascii"))
    except ValueError as wrong:
        raise TlsError(f"{locate(file)}: is damaged: {wrong}") from wrong
