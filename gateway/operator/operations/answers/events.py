"""The result of `events`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

#: An event as a JSON object, as `/api/v1/events` tells it: `timestamp`, `event`, `level`, and its own fields; and
#: beside these `text`, the event in words, how many `times` it has happened `since`, and its `number`.
Told = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Happened:
    """The last events, oldest first; `next` is what to ask for those `after` these."""

    events: Sequence[Told]
    next: int
