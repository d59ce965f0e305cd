"""Credentials files of NATS: a token, and the key with which the gateway proves that the token is its own."""

import base64
from typing import Final

from gateway.errors import FleetError

#: Said where the library is missing that signs with the key.
NO_LIBRARY: Final = (
    "a credentials file needs PyNaCl, which is not installed: apt install python3-nacl, or pip install pynacl"
)
_JWT_LINE: Final = "BEGIN NATS USER JWT"
_SEED_LINE: Final = "BEGIN USER NKEY SEED"
#: A seed is two bytes of what it is for, 32 of key and two of check sum.
_KEY: Final = slice(2, 34)
_SEED_SIZE: Final = 36


def read_credentials(text: str) -> tuple[bytes, bytes]:
    """The token and the private key in a credentials file.

    Raises:
        FleetError: it has none.
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
    """The signature of what the server asks to be signed.

    Raises:
        FleetError: the library for it is not installed.
    """
    try:
        from nacl.signing import SigningKey  # noqa: PLC0415 - only with `credentials`, and not everywhere there is one
    except ModuleNotFoundError as error:
        raise FleetError(NO_LIBRARY) from error
    return base64.b64encode(SigningKey(key).sign(nonce.encode()).signature)


def _line_after(marker: str, text: str) -> str:
    lines = iter(text.splitlines())
    return next((next(lines, "").strip() for line in lines if marker in line), "")
