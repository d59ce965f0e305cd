"""A config file as it may be shown: without what is nobody else's business. Paths of files with secrets stay."""

import re
from typing import Final

MASK: Final = "•••"

_NAMES: Final = r"[\w-]*(?:passw(?:or)?d|passphrase|secret|token|psk)[\w-]*"
_TEXT: Final = r'"""(?:.*?)"""|\'\'\'(?:.*?)\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\''
_VALUE: Final = re.compile(rf"""(?P<key>["']?{_NAMES}["']?\s*=\s*)(?P<value>{_TEXT})""", re.DOTALL | re.IGNORECASE)
_COMMENT: Final = re.compile(rf"(?P<key>#[^\n]*?\b{_NAMES}\s*[=:]\s*)(?P<value>[^\n]*)", re.IGNORECASE)
_ADDRESS: Final = re.compile(r"(?P<key>\b[a-z][a-z0-9+.-]*://[^/\s:@\"']*:)(?P<value>[^/\s@\"']+)(?=@)", re.IGNORECASE)
_KEY: Final = re.compile(r"(?P<key>-----BEGIN [A-Z ]*PRIVATE KEY-----).*?(?=-----END|\Z)", re.DOTALL)


def masked(text: str) -> str:
    """The text of a config file with a mask in place of passwords, tokens and private keys."""
    text = _KEY.sub(rf"\g<key>{MASK}", text)
    text = _VALUE.sub(_mask, text)
    text = _COMMENT.sub(_mask, text)
    return _ADDRESS.sub(rf"\g<key>{MASK}", text)


def _mask(match: re.Match[str]) -> str:
    value = match["value"]
    is_path = value.strip("\"' ").startswith("/") and "\n" not in value
    return match[0] if is_path or MASK in value else f'{match["key"]}"{MASK}"'
