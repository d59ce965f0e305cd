"""Two config files line by line, as they may be shown; and whether sites have the same one."""

import hashlib
import re
from collections.abc import Iterator
from difflib import unified_diff
from typing import Final

from gateway.config.reading.masking import masked

#: This many lines of a comparison are shown, and this many characters of each.
MOST_LINES: Final = 400
_LONGEST: Final = 500
_DIGITS: Final = 12


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
