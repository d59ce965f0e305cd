"""Tokens of programs, in the file with the users: an entry for each, with the role and the hash of the token.

ingest:operator:$scrypt$ln=1,r=1,p=1$token/of/program$HASH

A password needs a salt and a hash that takes long, because people choose what can be guessed. A token is 256 random
bits: nobody can try so many, however fast the hash is. So it is scrypt at its lowest cost, 10 µs: it is computed with
each request, in the loop that serves the lines. It has the form of a user's hash so that older versions can read the
file. To them it is a user whose password is the token, with the same role.
"""

import hashlib
import re
import secrets
from base64 import b64decode, b64encode
from typing import Final

#: What each token begins with: who finds one in a text knows what it is, and so do programs that look for secrets.
PREFIX: Final = "mbgw_"
_TOKEN: Final = re.compile(rf"{PREFIX}[A-Za-z0-9_-]{{43}}")
#: What stands in the place of a salt. It makes the entry of a token known as one: salts of passwords are random.
_MARK: Final = "token/of/program"
_BEGIN: Final = f"$scrypt$ln=1,r=1,p=1${_MARK}$"


def new_token() -> str:
    """Make a token: 256 random bits."""
    return PREFIX + secrets.token_urlsafe(32)


def token_hash(token: str) -> str:
    """Hash a token for the file; empty if it does not have the form of one. Takes some microseconds."""
    if _TOKEN.fullmatch(token) is None:
        return ""
    return _BEGIN + b64encode(hashlib.scrypt(token.encode(), salt=b64decode(_MARK), n=2, r=1, p=1, dklen=32)).decode()


def is_of_token(hash_: str) -> bool:
    """Tell whether a hash in the file is that of a token, and not of a password."""
    return hash_.startswith(_BEGIN)
