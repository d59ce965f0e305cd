"""The built-in profiles for simulated devices: their functions, answer times and idle times."""

from gateway.config.load import builtin_profiles
from gateway.config.resolve import profile_of
from gateway.profiles.profile import Profile


def builtin_profile(name: str) -> Profile:
    """The built-in profile `name`."""
    return profile_of(name, builtin_profiles()[name])
