"""The built-in profiles, as tables."""

import tomllib
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from gateway.config.schema.profile import ProfileTable
from gateway.profiles import BUILTIN_PROFILES, builtin_text

#: The section of profiles.
PROFILE: Final = "profile"


@lru_cache(maxsize=1)
def builtin_profiles() -> Mapping[str, ProfileTable]:
    """Read the built-in profiles, by name."""
    return {
        name: ProfileTable.model_validate(tomllib.loads(builtin_text(name))[PROFILE][name]).placed(
            (PROFILE, name), "built in"
        )
        for name in BUILTIN_PROFILES
    }
