"""The built-in profiles: the TOML files beside this module, written as users write their own."""

from importlib.resources import files

BUILTIN_PROFILES = ("generic", "mint", "v80", "weigher")


def builtin_text(name: str) -> str:
    """The TOML text of the built-in profile `name`, one of `BUILTIN_PROFILES`."""
    return files(__package__).joinpath(f"{name}.toml").read_text(encoding="utf-8")
