"""The result of a rule."""

from dataclasses import dataclass
from typing import Final, Literal

Level = Literal["ok", "note", "fix"]

#: The beginning of the finding about a line that is down.
IS_DOWN: Final = "is down: "


@dataclass(frozen=True, slots=True)
class Finding:
    """One row: `what` was found `about` a port, line, unit or client; `remedy` is a command, config line or advice.

    `unit` is the name of the unit if it is about one. A `fix` needs action; a `note` may be intended.
    """

    level: Level
    about: str
    what: str
    remedy: str = ""
    unit: str = ""
