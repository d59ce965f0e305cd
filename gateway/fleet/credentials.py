"""NATS credentials files: a token, and the private key that proves its possession."""

import base64
from typing import Final

from gateway.errors import FleetError

#: The error where the signing library is missing.
NO_LIBRARY: Final = (
    "a credentials file needs PyNaCl, which is not installed: apt install python3-nacl, or pip install pynacl"
)
_JWT_LINE: Final = "BEGIN NATS USER JWT"
_SEED_LINE: Final = "BEGIN USER NKEY SEED"
#: A seed is two bytes of type, 32 of key and two of checksum.
_KEY: Final = slice(2, 34)
_SEED_SIZE: Final = 36


def read_credentials(text: str) -> tuple[bytes, bytes]:
    """Read the token and the private key from the text of a credentials file.

    Raises:
        FleetError: one of them is missing or malformed.
    """
    token, seed = _line_after(_JWT_LINE, text), _line_after(_SEED_LINE, text)
    try:
        raw = base64.b32decode(seed + "=" * (-len(seed) % 8))
    except ValueError:
        raw = b""
    if not token or len(raw) != _SEED_SIZE:
        raise FleetError("it is not a credentials file: that has the token and the seed of a user")
    return token.encode(), raw[_KEY]


def sign(key: bytes, nonce: str) -> bytes:
    """Sign the server's `nonce`. Return the signature in Base64.

    Raises:
        FleetError: the signing library is not installed.
    """
    try:
        from nacl.signing import SigningKey  # noqa: PLC0415 - optional: only for `credentials`
    except ModuleNotFoundError as error:
        raise FleetError(NO_LIBRARY) from error
    return base64.b64encode(SigningKey(key).sign(nonce.encode()).signature)


def _line_after(marker: str, text: str) -> str:
    lines = iter(text.splitlines())
    return next((next(lines, "").strip() for line in lines if marker in line), "")
