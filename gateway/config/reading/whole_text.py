"""The text of a config with those of the files that it includes, as it is shown, compared and kept."""

import re
from collections.abc import Mapping
from typing import Final

#: What begins the line above the text of an included file.
MARK: Final = "#:include "
_MARKED: Final = re.compile(rf"^{MARK}(.*)\n", re.MULTILINE)
#: Also in a last line without an end, which `joined` ends.
_LIKE_ONE: Final = re.compile(f"^{MARK}", re.MULTILINE)


def joined(own: str, included: Mapping[str, str]) -> str:
    """Join the text of a config and those of the files that it includes, by their names."""
    if not included:
        return own
    return "".join([ended(own), *(f"{MARK}{name}\n{ended(text)}" for name, text in included.items())])


def parted(whole: str) -> tuple[str, dict[str, str]]:
    """Take the text of a config and those of the files that it includes apart."""
    own, *others = _MARKED.split(whole)
    return own, dict(zip(others[::2], others[1::2], strict=True))


def unmarked(text: str) -> str:
    """Change comments of a file that are the lines between files; nothing moves by that."""
    return _LIKE_ONE.sub(f"# {MARK[2:]}", text) if MARK in text else text


def ended(text: str) -> str:
    """End the last line of a text."""
    return text if text.endswith("\n") or not text else f"{text}\n"
