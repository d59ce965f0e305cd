"""What a rule has found."""

from dataclasses import dataclass
from typing import Literal

Level = Literal["ok", "note", "fix"]


@dataclass(frozen=True, slots=True)
class Finding:
    """`about` what, `what` was found there, and the command or config line that mends it (`remedy`).

    A `fix` needs something to be done; a `note` may be as it is meant to be.
    """

    level: Level
    about: str
    what: str
    remedy: str = ""
