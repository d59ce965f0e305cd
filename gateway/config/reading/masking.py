"""A config file without its secrets, as it may be shown, and two compared. The names of files with secrets stay."""

import hashlib
import re
import tomllib
from collections.abc import Iterator
from difflib import get_close_matches, unified_diff
from functools import lru_cache, partial
from typing import Final

from gateway.config.problem import Path
from gateway.config.reading.positions import Positions, Scalar
from gateway.config.reading.toml_text import value_text
from gateway.config.reading.whole_text import MARK

MASK: Final = "•••"

#: Parts of the names of keys that have secrets, and names that others may be a slip of.
_SECRET: Final = re.compile(
    r"pass|pasw|pwd|\bpw\b|kennw|secret|token|psk|api_?key|\bauth\b|login|\bcreds?\b|\bpin\b|contras|geheim|密码|口令|密钥",
    re.IGNORECASE,
)
_MEANT: Final = ("password", "passphrase", "token", "secret")
#: What may stand below such a name: where the secret is.
_PLACES: Final = frozenset({"file", "credential"})

#: Between values a quotation mark begins a key, which may have a number sign in it.
_KEY: Final = r""""(?:[^"\\\n]|\\.)*+"|'[^'\n]*+'"""
_KEY_OR_COMMENT: Final = re.compile(rf"({_KEY}|(?<=\n){MARK}[^\n]*\n)|(?<=\n)[ \t]*+#[^\n]*\n|(?<![ \t])[ \t]*+#[^\n]*")

#: A key and its value, in a text that may be no TOML.
_LIKE_A_SECRET: Final = re.compile(r"""([\w-]+)["']?\s*[=:]\s*["']?([^"'\s,}\]#]+)""")
#: This many lines of a comparison are shown, and this many characters of each.
MOST_LINES: Final = 400
_LONGEST: Final = 500
_DIGITS: Final = 12


def masked(text: str) -> str:
    """Remove comments from a config file, and put a mask in place of passwords, tokens and private keys.

    The names of files that it includes stay.

    Raises:
        ValueError: it is no TOML, so where its secrets are is not known.
        RecursionError: it is nested too deeply.
    """
    tomllib.loads(text)
    parts, at = list[str](), 0
    for path, start, end in Positions(text).scalars:
        parts += [_without_comments(text[at:start]), _masked(path, text[start:end])]
        at = end
    return "".join([*parts, _without_comments(text[at:])])


def find_masks(value: object, path: Path = ()) -> Iterator[Path]:
    """Find where a mask stands in a document, or in a value at `path`: that is no secret, but what hides one."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from find_masks(each, (*path, key))
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from find_masks(each, (*path, index))
    elif isinstance(value, str) and (value == MASK or f"://{MASK}@" in value):
        yield path


def secrets_in(text: str) -> set[str]:
    """List what `masked` hides, to hide it elsewhere too; of a text that is no TOML what looks like a secret."""
    try:
        tomllib.loads(text)
        hidden = [text[start:end] for _, start, end in filter(partial(is_hidden, text), Positions(text).scalars)]
        values = [str(tomllib.loads(f"value = {written}")["value"]) for written in hidden]
    except (ValueError, RecursionError):
        return {found[2] for found in _LIKE_A_SECRET.finditer(text) if is_secret(found[1])}
    users = [value.partition("://")[2].rpartition("@")[0] for value in values]
    return {part for each in (values, users, [user.rpartition(":")[2] for user in users]) for part in each if part}


def is_hidden(text: str, value: Scalar) -> bool:
    """Tell whether `masked` hides something of a value of this text."""
    path, start, end = value
    return _masked(path, text[start:end]) != text[start:end]


@lru_cache(maxsize=1024)
def is_secret(key: str) -> bool:
    """Tell whether the value of a key, dotted perhaps, may be a secret, by its name or what that may be a slip of."""
    return any(
        _SECRET.search(part) is not None or get_close_matches(part.lower(), _MEANT, 1, 0.8) for part in key.split(".")
    )


def _masked(path: Path, written: str) -> str:
    """Mask a value if there is something to hide; otherwise leave it as it is written."""
    if path[-1] not in _PLACES and any(is_secret(key) for key in path if isinstance(key, str)):
        return value_text(MASK)
    if written[0] not in "\"'":
        return written
    value = tomllib.loads(f"value = {written}")["value"]
    if "PRIVATE KEY" in value:
        return value_text(MASK)
    scheme, separator, address = value.partition("://")
    if not separator or "@" not in address:
        return written
    return value_text(f"{scheme}://{MASK}@{address.rpartition('@')[2]}")


def _without_comments(between: str) -> str:
    return _KEY_OR_COMMENT.sub(lambda found: found[1] or "", between)


def shown(text: str) -> str:
    """Leave out comments, secrets and empty lines at the begin of a text; return nothing of one that is not TOML."""
    try:
        return masked(text).lstrip("\n")
    except (ValueError, RecursionError):
        return ""


def difference(old: str, new: str, old_name: str, new_name: str) -> tuple[str, ...]:
    """Compare two texts that were `shown`, line by line; return nothing if one of them is empty."""
    if not (old and new):
        return ()
    return tuple(_cut(unified_diff(old.splitlines(), new.splitlines(), old_name, new_name, n=2, lineterm="")))


def _cut(lines: Iterator[str]) -> Iterator[str]:
    for count, line in enumerate(lines):
        if count == MOST_LINES:
            yield "..."
            return
        yield line if len(line) <= _LONGEST else f"{line[:_LONGEST]}..."


def fingerprint(text: str, site: str) -> str:
    """Make 12 hexadecimal digits of a config file; empty for one that a program has made.

    They are the same for two sites if their files differ only in comments, in secrets, and where the file has the name
    of the site: as `site`, as its user, in names of files and leases.
    """
    in_use = shown(text)
    if site:
        in_use = re.sub(rf"(?<![\w-]){re.escape(site)}(?![\w-])", "SITE", in_use)
    return hashlib.sha256(in_use.encode()).hexdigest()[:_DIGITS] if in_use else ""
