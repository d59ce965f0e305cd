"""What a line carried."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class BenchRead:
    """What is read of one unit, and how long that takes the line by arithmetic."""

    unit: int
    name: str
    area: str
    address: int
    items: int
    line_time_ms: float
    answer_time_known: bool


@dataclass(slots=True)
class BenchResult:
    """What a line carried in `seconds`: reads by what became of them.

    `others` are the frames that it carried for other clients meanwhile. Both rates are reads in a second; the
    arithmetic takes a line that carries nothing else, and is None if nothing takes any time there. Units that rest, or
    came to rest meanwhile, were `left_out`.
    """

    line: str
    reads: tuple[BenchRead, ...]
    seconds: float = 0.0
    answered: int = 0
    exceptions: int = 0
    failed: int = 0
    others: int = 0
    busy_share: float = 0.0
    last_failure: str = ""
    left_out: list[str] = field(default_factory=list)
    expected_per_second: float | None = None
    measured_per_second: float = 0.0


@dataclass(frozen=True, slots=True)
class BenchProgress:
    """How far a measurement is: after so many seconds, so many reads have ended."""

    elapsed_s: float
    reads: int


@dataclass(frozen=True, slots=True)
class BenchStep:
    """An answer of `bench`: its `progress`, or at last its result."""

    progress: BenchProgress | None = None
    bench: BenchResult | None = None
