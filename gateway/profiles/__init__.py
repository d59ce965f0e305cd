"""What a kind of device accepts and how fast it answers. The built-in ones are the TOML files in this folder."""

from pathlib import Path
from typing import Final

#: The built-in profiles, written as users write their own.
BUILTIN_PROFILES: Final = ("generic", "mint", "v80", "weigher")

_FOLDER: Final = Path(__file__).parent


def builtin_text(name: str) -> str:
    """Read the TOML text of the built-in profile `name`, one of `BUILTIN_PROFILES`."""
    return _FOLDER.joinpath(f"{name}.toml").read_text(encoding="utf-8")
