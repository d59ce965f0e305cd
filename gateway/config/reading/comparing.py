"""Two config files line by line, as they may be shown."""

from collections.abc import Iterator
from difflib import unified_diff
from typing import Final

from gateway.config.reading.masking import masked

#: This many lines of a comparison are shown, and this many characters of each.
MOST_LINES: Final = 400
_LONGEST: Final = 500


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
