"""Results of `bench`."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class BenchRead:
    """A read of one unit, and the time that it should take the line by calculation.

    Unless `answer_time_known`, the device is assumed to respond at once.
    """

    unit: int | None
    name: str
    area: str
    address: int
    items: int
    line_time_ms: float
    answer_time_known: bool


@dataclass(slots=True)
class BenchResult:
    """Reads of a line during `seconds`, by what became of them.

    `others` are the frames that it carried for other clients meanwhile. Both rates are reads per second; the expected
    one is calculated for a line that carries nothing else, and is None if the calculated time is 0. Units in `left_out`
    were resting, or began to.
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
    """The progress of a measurement: `reads` have ended after `elapsed_s` seconds."""

    elapsed_s: float
    reads: int


@dataclass(frozen=True, slots=True)
class BenchStep:
    """An answer of `bench`: its `progress`, or the result as the last one."""

    progress: BenchProgress | None = None
    bench: BenchResult | None = None
