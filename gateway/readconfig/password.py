"""Reads passwords and credentials for a broker or for NATS, and the token of the page, from their files."""

from errno import EINVAL
from pathlib import Path
from typing import Final

from gateway.errors import BrokerError, GatewayError
from gateway.tls.files import find_path, read_whole, refuse_if_exposed, refuse_if_no_file
from gateway.tls.settings import SecretFile

#: In bytes.
_LONGEST_PASSWORD: Final = 1024
_LONGEST_SECRET: Final = 65536


def read_password(file: SecretFile, kind: type[GatewayError] = BrokerError) -> str:
    """Read a password: the first line of its file.

    Raises:
        GatewayError: of this `kind`; the file cannot be read, or the password is too long or not UTF-8.
    """
    line = _read(file, kind, _LONGEST_PASSWORD + 1).partition(b"\n")[0].rstrip(b"\r")
    if len(line) > _LONGEST_PASSWORD:
        raise kind(f"{find_path(file)}: the password has more than {_LONGEST_PASSWORD} bytes")
    return _decode(line, file, kind, "the password")


def read_token(file: str) -> str:
    """Read the token that programs send to the page.

    Raises:
        OSError: others may read the file, this process may not, or it is empty.
    """
    path = Path(file)
    refuse_if_exposed(path)
    token = read_whole(path, _LONGEST_SECRET).decode("ascii", errors="replace").strip()
    if not token:
        raise OSError(EINVAL, "the file is empty", file)
    return token


def read_secret(file: SecretFile, kind: type[GatewayError]) -> str:
    """Read a file as text, up to 64 KiB.

    Raises:
        GatewayError: of this `kind`; the file cannot be read, or is not UTF-8.
    """
    return _decode(_read(file, kind, _LONGEST_SECRET), file, kind, "it")


def _read(file: SecretFile, kind: type[GatewayError], size: int) -> bytes:
    try:
        path = find_path(file)
        if not file.is_credential:
            refuse_if_exposed(path)
        refuse_if_no_file(path)
        with path.open("rb") as stream:
            return stream.read(size)
    except OSError as error:
        raise kind(f"{error.filename or file.name}: {error.strerror or error}") from error


def _decode(text: bytes, file: SecretFile, kind: type[GatewayError], what: str) -> str:
    try:
        return text.decode()
    except UnicodeDecodeError:
        raise kind(f"{find_path(file)}: {what} is not UTF-8 text") from None
