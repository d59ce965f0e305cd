"""What a kind of device accepts, how fast it answers, and what its registers mean.

The shipped profiles are the TOML files in this folder, one kind of device each, written as users write their own.

- profile, point    the rules for requests, and the values
- coding, conversion    a point's number in its items, and in those of another point
- guards       what may be written to points with limits, by whomever
- read_rules, holes, published    what one read of a device may take, and the points that are published
- identity, recognition, sunspec    what tells the kind of a unit, and the reads that find it
- columns      a table of points as CSV
"""

import re
from pkgutil import get_data
from typing import Final

#: The names that files can have.
_NAME: Final = re.compile(r"\w[\w.-]*")


def shipped_names() -> list[str]:
    """List the shipped profiles."""
    from importlib.resources import files  # noqa: PLC0415 - it takes longer than to read a profile

    return sorted(each.name[:-5] for each in files(__name__).iterdir() if each.name.endswith(".toml"))


def shipped_text(name: str) -> str | None:
    """Read the TOML text of the shipped profile `name`; None if there is none."""
    if not is_file_name(name):
        return None
    try:
        content = get_data(__name__, f"{name}.toml")
    except OSError:
        return None
    return None if content is None else content.decode()


def is_file_name(name: str) -> bool:
    """Tell whether a file can have the name of this profile."""
    return _NAME.fullmatch(name) is not None
