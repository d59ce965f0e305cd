"""The files that docs/library.md shows: a block whose first line is a comment with a name."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = DOCS / "examples"
_FILE = re.compile(r"^```\w+\n(# (\S+)\n.*?)^```$", re.MULTILINE | re.DOTALL)


def files_of_the_guide() -> dict[str, str]:
    """Return their texts by their names."""
    return {name: text for text, name in _FILE.findall((DOCS / "library.md").read_text(encoding="utf-8"))}
