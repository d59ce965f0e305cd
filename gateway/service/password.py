"""The password for the broker, as its file has it."""

from typing import Final

from gateway.errors import BrokerError
from gateway.tls.files import path_of, refuse_if_exposed
from gateway.tls.secret_file import SecretFile

#: In bytes.
_LONGEST_PASSWORD: Final = 1024


def read_password(file: SecretFile) -> str:
    """Read a password: the first line of its file.

    Raises:
        BrokerError: it cannot be read, or is none.
    """
    try:
        path = path_of(file)
        if not file.is_credential:
            refuse_if_exposed(path)
        with path.open("rb") as stream:
            line = stream.readline(_LONGEST_PASSWORD + 1).rstrip(b"\r\n")
    except OSError as error:
        raise BrokerError(f"{error.filename or file.name}: {error.strerror or error}") from error
    if len(line) > _LONGEST_PASSWORD:
        raise BrokerError(f"{path}: the password has more than {_LONGEST_PASSWORD} bytes")
    try:
        return line.decode()
    except UnicodeDecodeError:
        raise BrokerError(f"{path}: the password is not UTF-8 text") from None
