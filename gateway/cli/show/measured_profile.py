"""A profile with measured times, as text for a config: a shipped one with other times, or the times alone."""

import re
from typing import Final

from gateway.profiles import shipped_text

_COMMENT: Final = re.compile(r"\A(#.*\n)*\n*")
_HEADING: Final = re.compile(r"^\[profile\.[^]]*\]\n", re.MULTILINE)
_TIMING: Final = re.compile(r"^timing\s*=\s*\[\n.*?^\]\n", re.MULTILINE | re.DOTALL)
_MARGIN: Final = re.compile(r"^margin\s*=.*\n", re.MULTILINE)


def profile_text(profile: str, timing: str, margin: float, origin: str) -> str:
    """Write the TOML table of the profile `NAME-measured`, with a `timing` key as text, and where that comes from."""
    name = f"{profile}-measured"
    key = f"{timing}\nmargin    = {margin:g}\n"
    shipped = shipped_text(profile)
    if shipped is None:
        return f"# {origin}\n# Add the other keys of [profile.{profile}].\n\n[profile.{name}]\n{key}"
    text = _COMMENT.sub("", shipped)
    text = _MARGIN.sub("", _TIMING.sub("", text))
    return f"# {origin}\n# All else is as in the shipped profile {profile}.\n\n" + _HEADING.sub(
        lambda _: f"[profile.{name}]\n{key}", text, count=1
    )
