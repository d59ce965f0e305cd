"""The files of the state folder for the status."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class StateFileStatus:
    """A file of the state folder, or the folder, that cannot be written; or a file that was damaged at the start."""

    file: str
    state: Literal["not written", "damaged"]
    reason: str
