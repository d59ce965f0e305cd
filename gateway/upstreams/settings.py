"""The settings of an upstream."""

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class UpstreamSettings:
    """The settings of one upstream; times in seconds.

    At most `in_flight` requests are under way and `queue` more wait, each for at most `max_wait`. `gap` is the silence
    between a response and the next request, `after_connect` that after connecting. The connection is closed after
    `idle` seconds without a request, 0 for never. `rest` is the longest rest of a unit, None for the default, 0 for
    none. With `transaction_id` "zero", the server may answer with identifier 0; then `in_flight` is 1, and so with a
    `gap`.
    """

    name: str
    in_flight: int = 16
    gap: float = 0.0
    after_connect: float = 0.0
    idle: float = 0.0
    coalesce: bool = True
    retries: int = 0
    rest: float | None = None
    queue: int = 64
    max_wait: float = 2.0
    transaction_id: Literal["checked", "zero"] = "checked"
    source: str = field(default="", compare=False)
