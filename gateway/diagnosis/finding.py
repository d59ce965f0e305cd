"""The result of a rule."""

from dataclasses import dataclass
from typing import Final, Literal

Level = Literal["ok", "note", "fix"]

#: How it begins, what is said of a line that is down.
IS_DOWN: Final = "is down: "


@dataclass(frozen=True, slots=True)
class Finding:
    """One row: `what` was found `about` a port, line, unit or client. `remedy` is the command or config line for it.

    `unit` is the name of the unit if it is about one. A `fix` needs something to be done; a `note` may be as it is
    meant to be.
    """

    level: Level
    about: str
    what: str
    remedy: str = ""
    unit: str = ""
