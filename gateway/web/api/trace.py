"""Which records of the trace an HTTP request asks for."""

from dataclasses import dataclass
from typing import Annotated, Final

from gateway.operator.operations.asked import LineNamed, Traced, UnitNamed, WithPoints
from gateway.operator.operations.parameters import Within

#: A reader of the trace may begin this many seconds before.
LONGEST_LOOK_BACK: Final = 3600
#: The most records that a sample has in a second.
MOST_PER_SECOND: Final = 2000

_Seconds = Annotated[
    int,
    Within(0, LONGEST_LOOK_BACK),
    f"a whole number of seconds from 0 to {LONGEST_LOOK_BACK}, before now",
]


@dataclass(frozen=True, slots=True)
class RecordsToCapture:
    """Records of the last `seconds`, for a file."""

    line: LineNamed | None = None
    unit: UnitNamed | None = None
    function: Annotated[int | None, Within(1, 127), "a whole number from 1 to 127"] = None
    client: Annotated[str | None, "a client, or its address"] = None
    result: Annotated[
        str | None, "ok, exception, failed (all others), or one of these: timeout, resting, queue_full, denied, ..."
    ] = None
    seconds: _Seconds = 30

    @property
    def traced(self) -> Traced:
        """The same selection for the ring."""
        return Traced(
            since=self.seconds,
            line=self.line,
            unit=self.unit,
            function=self.function,
            client=self.client,
            result=self.result,
        )


@dataclass(frozen=True, slots=True)
class RecordsToFollow(RecordsToCapture):
    """Records as they come, and those of the last `seconds`; at most `per_second`, if set."""

    seconds: _Seconds = 0
    per_second: Annotated[
        int | None,
        Within(1, MOST_PER_SECOND),
        f"a whole number from 1 to {MOST_PER_SECOND}; `clock` tells in `left_out` how many others there were",
    ] = None
    points: WithPoints = False
