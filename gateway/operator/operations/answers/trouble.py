"""What is wrong now."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

#: From this busy share on a line is said to be full.
FULL: Final = 0.85
#: How bad a trouble is, from the worst on. A panel has room for some only.
_BADNESS: Final = ("down", "resting", "fix", "full", "failing")


@dataclass(frozen=True, slots=True)
class Trouble:
    """What is wrong with the line, unit or broker of this name, or the config; a `reason` is in the gateway's words.

    `share` is the share of time in which a line was busy, or of unanswered `requests` of a unit in the last minutes; of
    these, `unsent` were not sent, most often for the result `unsent_for`. A resting unit is left alone for `rests_ms`
    more. `found` is what doctor says must be fixed.
    """

    kind: Literal["down", "resting", "failing", "full", "fix"]
    page: Literal["lines", "units", ""]
    name: str
    line: str = ""
    reason: str = ""
    share: float = 0.0
    requests: int = 0
    rests_ms: float = 0.0
    unsent: int = 0
    unsent_for: str = ""
    found: tuple[str, ...] = ()


def worst_first(known: Sequence[Trouble]) -> list[Trouble]:
    """Sort troubles, the worst first; a failing unit with a finding counts as one that must be fixed."""
    return sorted(known, key=lambda each: _BADNESS.index("fix" if each.found and each.kind == "failing" else each.kind))
