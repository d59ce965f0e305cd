"""A config file as it may be shown: without what is nobody else's business. Names of files with secrets stay."""

import re
from difflib import get_close_matches
from functools import lru_cache
from typing import Final

MASK: Final = "•••"

#: Parts of the names of keys that have secrets, and names that others may be a slip of.
_SECRET: Final = re.compile(r"pass|pasw|passw|pwd|kennw|secret|token|psk|api_?key", re.IGNORECASE)
_MEANT: Final = ("password", "passphrase", "token", "secret")
#: What may stand beside such a name: where the secret is.
_PLACES: Final = frozenset({"file", "credential"})

_STRING: Final = r'"""(?:.*?)"""|\'\'\'(?:.*?)\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\''
_HEADER: Final = re.compile(r"^(\s*\[+[^\]\n=]*\]+)", re.MULTILINE)
_KEY: Final = re.compile(r"""["']?(?P<name>[\w.-]+)["']?[ \t]*[=:][ \t]*""")
#: A list or text may have several lines; what has no quotes reaches to the end of its line, whatever is in it.
_LIST: Final = rf"""\[(?>{_STRING}|[^\]"'])*+(?:\]|\Z)"""
_VALUE: Final = re.compile(rf"(?:{_STRING})(?=\s*(?:[,}}\]#\n]|\Z))|{_LIST}|[^\n]*", re.DOTALL)
_PLACE: Final = re.compile(rf"\{{\s*(?:{'|'.join(_PLACES)})\s*=\s*(?:{_STRING})\s*\}}")
_ADDRESS: Final = re.compile(r"(?P<key>\b[a-z][a-z0-9+.-]*://[^/\s:@\"']*:)(?P<value>[^/\s@\"']+)(?=@)", re.IGNORECASE)
_PRIVATE_KEY: Final = re.compile(r"(?P<key>-----BEGIN [A-Z ]*PRIVATE KEY-----).*?(?=-----END|\Z)", re.DOTALL)


def masked(text: str) -> str:
    """The text of a config file with a mask in place of passwords, tokens and private keys."""
    text = _PRIVATE_KEY.sub(rf"\g<key>{MASK}", text)
    header, *others = _HEADER.split(text)
    parts = [_masked(header, has_secrets=False)]
    for table, content in zip(others[::2], others[1::2], strict=True):
        parts += [table, _masked(content, has_secrets=is_secret(table.strip("[] \t\n")))]
    return _ADDRESS.sub(rf"\g<key>{MASK}", "".join(parts))


@lru_cache(maxsize=1024)
def is_secret(key: str) -> bool:
    """Whether the value of a key, dotted perhaps, may be a secret, by its name or what that may be a slip of."""
    return any(
        _SECRET.search(part) is not None or get_close_matches(part.lower(), _MEANT, 1, 0.8) for part in key.split(".")
    )


def _masked(text: str, *, has_secrets: bool) -> str:
    """The text with masks for values of secret keys; of all keys in a table that `has_secrets`."""
    parts, at = list[str](), 0
    for key in _KEY.finditer(text):
        if key.start() < at or not (has_secrets or is_secret(key["name"])):
            continue
        is_place = key["name"].rpartition(".")[2] in _PLACES
        place = None if is_place else _PLACE.match(text, key.end())
        value = _VALUE.match(text, key.end())
        if value is None or is_place or place or not value[0].strip() or MASK in value[0]:
            continue
        parts += [text[at : key.end()], f'"{MASK}"']
        at = value.end()
    return "".join([*parts, text[at:]])
