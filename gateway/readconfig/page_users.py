"""The file with the users of the web page: a line for each, with the role and the hash of the password, or the token.

anna:operator:$scrypt$ln=14,r=8,p=5$SALT$HASH

The password itself is not stored. A guess costs 16 MiB and some tenths of a second (RFC 7914, with the parameters that
OWASP recommends for 16 MiB).

ingest:operator:$scrypt$ln=1,r=1,p=1$token/of/program$HASH

A password needs a salt and a hash that takes long, because people choose what can be guessed. A token is 256 random
bits: nobody can try so many, however fast the hash is. So it is scrypt at its lowest cost, 10 µs: it is computed with
each request, in the loop that serves the lines. To older versions it is a user whose password is the token.
"""

import binascii
import fcntl
import hashlib
import hmac
import os
import re
import secrets
import stat
from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, get_args

from gateway.errors import UsersError

Role = Literal["viewer", "operator"]
ROLES: Final[tuple[Role, ...]] = get_args(Role)

#: The shortest password, in characters, and the longest, in bytes.
SHORTEST_PASSWORD: Final = 8
LONGEST_PASSWORD: Final = 1024
#: The largest file that is read, in bytes.
MOST_READ: Final = 1024 * 1024

#: log2 of the cost, block size, parallelization; and the highest ones accepted from a file: a login must not cost more.
_COST: Final = (14, 8, 5)
_HIGHEST_COST: Final = (17, 16, 16)
_MEMORY: Final = 512 * 1024 * 1024
_SALT: Final = 16

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
_HASH: Final = re.compile(r"\$scrypt\$ln=(\d{1,2}),r=(\d{1,2}),p=(\d{1,2})\$([A-Za-z0-9+/=]+)\$([A-Za-z0-9+/=]+)")
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


@dataclass(frozen=True, slots=True)
class User:
    """A person who may log in, or a program with a token; and the hash of the password, or of the token."""

    name: str
    role: Role
    hash: str

    @property
    def is_program(self) -> bool:
        """Whether it is a program with a token, which cannot log in."""
        return is_of_token(self.hash)

    def __repr__(self) -> str:
        return f"<User {self.name} {self.role}>"


Users = Mapping[str, User]


def is_user_name(name: str) -> bool:
    """Tell whether a user may have this name: 1 to 64 letters and digits, and . _ @ - after the first."""
    return _NAME.fullmatch(name) is not None


def password_trouble(password: str) -> str:
    """Say why a password cannot be used; empty if it can."""
    if len(password) < SHORTEST_PASSWORD:
        return f"it must have {SHORTEST_PASSWORD} characters at least"
    if len(password.encode(errors="surrogateescape")) > LONGEST_PASSWORD:
        return f"it must have {LONGEST_PASSWORD} bytes at most"
    return ""


def hashed(password: str) -> str:
    """Hash a password for the file, with a new salt. Takes some tenths of a second."""
    salt = secrets.token_bytes(_SALT)
    log_n, r, p = _COST
    return f"$scrypt$ln={log_n},r={r},p={p}${_text(salt)}${_text(_scrypt(password, salt, _COST))}"


def is_password(password: str, user: User | None) -> bool:
    """Tell whether `user` has this password. It takes as long for None, so as not to reveal which users exist."""
    match = _HASH.fullmatch(_NOBODY if user is None else user.hash)
    assert match is not None  # noqa: S101 - parse_users accepts no other hash
    cost = (int(match[1]), int(match[2]), int(match[3]))
    is_equal = hmac.compare_digest(_scrypt(password, b64decode(match[4]), cost), b64decode(match[5]))
    return is_equal and user is not None


def read_users(path: Path) -> Users:
    """Read the users in a file, by name.

    Raises:
        OSError: it cannot be read.
        UsersError: a line is not a user, or a name occurs twice.
    """
    with path.open("rb") as file:
        return parse_users(file.read(MOST_READ).decode("utf-8", "replace"), str(path))


def parse_users(text: str, file: str) -> Users:
    """Parse the users in `text`, by name; messages name `file`. Empty lines and lines that begin with # are ignored.

    Raises:
        UsersError: a line is not a user, or a name occurs twice. The message does not quote the line.
    """
    users: dict[str, User] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        name, _, rest = line.partition(":")
        role, _, hash_ = rest.partition(":")
        known = next((each for each in ROLES if each == role), None)
        if not is_user_name(name) or known is None or not _is_hash(hash_):
            raise UsersError(f"{file}:{number}: this is no user; lines are made by modbus-gateway user add")
        if name in users:
            raise UsersError(f"{file}:{number}: {name} is there twice")
        users[name] = User(name, known, hash_)
    return users


@contextmanager
def changing_users(path: Path) -> Iterator[dict[str, User]]:
    """Yield the users of a file, by name, to be changed; at the end the file is replaced as a whole.

    Only the owner can read a new file; if root makes it, the folder's owner owns it. Other processes wait to change it.

    Raises:
        OSError: it cannot be read or written.
        UsersError: a line is not a user, or a name occurs twice.
    """
    path = Path(os.path.realpath(path))
    with _locked(path.parent):
        try:
            users = dict(read_users(path))
        except FileNotFoundError:
            users = {}
        before = dict(users)
        yield users
        if users != before:
            _replace(path, "".join(f"{each.name}:{each.role}:{each.hash}\n" for each in users.values()))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _replace(path: Path, text: str) -> None:
    """Replace the file by one with its owner and rights; a power cut leaves the old or the new one."""
    try:
        old, mode = path.stat(), stat.S_IMODE(path.stat().st_mode) & ~stat.S_IRWXO & ~stat.S_IWGRP
    except FileNotFoundError:
        old, mode = path.parent.stat(), 0o600
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            if os.geteuid() == 0:
                os.fchown(file.fileno(), old.st_uid, old.st_gid)
            os.fchmod(file.fileno(), mode)
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except OSError:
        with suppress(OSError):
            new.unlink()
        raise


def _is_hash(text: str) -> bool:
    match = _HASH.fullmatch(text)
    if match is None:
        return False
    cost = (int(match[1]), int(match[2]), int(match[3]))
    try:
        salt, key = b64decode(match[4], validate=True), b64decode(match[5], validate=True)
    except binascii.Error:
        return False
    is_bearable = all(1 <= one <= most for one, most in zip(cost, _HIGHEST_COST, strict=True))
    return is_bearable and bool(salt) and len(key) == 32


def _scrypt(password: str, salt: bytes, cost: tuple[int, int, int]) -> bytes:
    log_n, r, p = cost
    data = password.encode(errors="surrogateescape")
    return hashlib.scrypt(data, salt=salt, n=2**log_n, r=r, p=p, maxmem=_MEMORY, dklen=32)


def _text(data: bytes) -> str:
    return b64encode(data).decode()


#: The hash to compare with if there is no such user: it costs the same.
_NOBODY: Final = "$scrypt$ln={},r={},p={}${}${}".format(*_COST, _text(bytes(_SALT)), _text(bytes(32)))
