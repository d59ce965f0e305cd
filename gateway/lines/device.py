from dataclasses import dataclass
from typing import Literal
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """One device of a line: `unit` on the wire, `known_as` to clients. `source` is where the config names it."""

    name: str
    unit: int
    known_as: int
    profile: Profile
    answer_time: AnswerTime
    priority: Literal["normal", "high"] = "normal"
    source: str = ""
