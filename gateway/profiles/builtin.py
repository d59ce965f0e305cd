"""The built-in profiles: the TOML files beside this module, written as users write their own."""

from pathlib import Path
from typing import Final

BUILTIN_PROFILES = ("generic", "mint", "v80", "weigher")

_FOLDER: Final = Path(__file__).parent


def builtin_text(name: str) -> str:
    """The TOML text of the built-in profile `name`, one of `BUILTIN_PROFILES`."""
    return _FOLDER.joinpath(f"{name}.toml").read_text(encoding="utf-8")
