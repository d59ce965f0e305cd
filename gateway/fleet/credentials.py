"""NATS credentials files: a private key, as the seed of an nkey, and with JWT accounts the token that it proves."""

import base64
import binascii
import os
from typing import TYPE_CHECKING, Final, NamedTuple

from gateway.errors import FleetError

if TYPE_CHECKING:
    from nacl.signing import SigningKey

#: The error where the signing library is missing.
NO_LIBRARY: Final = (
    "a credentials file needs PyNaCl, which is not installed: apt install python3-nacl, or pip install pynacl"
)
_JWT_LINE: Final = "BEGIN NATS USER JWT"
_SEED_LINE: Final = "BEGIN USER NKEY SEED"
#: A seed is two bytes of type, 32 of key and two of checksum.
_KEY: Final = slice(2, 34)
_KEY_SIZE: Final = 32
_SEED_SIZE: Final = 36
#: The types: a user's public key, and the seed of one. As text they begin with U and SU.
_USER: Final = b"\xa0"
_USER_SEED: Final = b"\x95\x00"

_FILE: Final = """\
# The login of the site {site} at the NATS server of its fleet. Whoever has this file can act as this site.
-----BEGIN USER NKEY SEED-----
{seed}
------END USER NKEY SEED------
"""


class Credentials(NamedTuple):
    """The content of a credentials file: the private key, and a token unless the server knows the key itself."""

    token: bytes | None
    key: bytes


def read_credentials(text: str) -> Credentials:
    """Read the text of a credentials file.

    Raises:
        FleetError: the seed is missing or malformed.
    """
    token, seed = _line_after(_JWT_LINE, text), _line_after(_SEED_LINE, text)
    try:
        raw = base64.b32decode(seed + "=" * (-len(seed) % 8))
    except ValueError:
        raw = b""
    if len(raw) != _SEED_SIZE:
        raise FleetError("it is not a credentials file: that has the seed of a user")
    return Credentials(token.encode() or None, raw[_KEY])


def make_credentials(site: str) -> str:
    """Make the text of a credentials file, with a new private key."""
    return _FILE.format(site=site, seed=_encode(_USER_SEED, os.urandom(_KEY_SIZE)))


def public_key(key: bytes) -> str:
    """Derive the public key from a private one, as the server's config has it.

    Raises:
        FleetError: the signing library is not installed.
    """
    return _encode(_USER, bytes(_signing_key(key).verify_key))


def sign(key: bytes, nonce: str) -> bytes:
    """Sign the server's `nonce`. Return the signature in Base64.

    Raises:
        FleetError: the signing library is not installed.
    """
    return base64.b64encode(_signing_key(key).sign(nonce.encode()).signature)


def _signing_key(key: bytes) -> "SigningKey":
    try:
        from nacl.signing import SigningKey  # noqa: PLC0415 - optional: only for `credentials`
    except ModuleNotFoundError as error:
        raise FleetError(NO_LIBRARY) from error
    return SigningKey(key)


def _encode(kind: bytes, key: bytes) -> str:
    """Write a key as an nkey: type, key and CRC-16/XMODEM in Base32."""
    data = kind + key
    return base64.b32encode(data + binascii.crc_hqx(data, 0).to_bytes(2, "little")).decode().rstrip("=")


def _line_after(marker: str, text: str) -> str:
    lines = iter(text.splitlines())
    return next((next(lines, "").strip() for line in lines if marker in line), "")
