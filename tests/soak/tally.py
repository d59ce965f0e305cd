"""What came of a soak: faults, outcomes, events and counts."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from kit.faulty import Fault


@dataclass
class Tally:
    """What was injected and what came of it; of one run or of several."""

    transactions: int = 0
    questions: int = 0
    broadcasts: int = 0
    abandoned: int = 0
    #: What other clients have asked on the lines.
    other_clients: int = 0
    injected: Counter[str] = field(default_factory=Counter)
    #: Fault and outcome of every answered question.
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    wrong_count: int = 0
    slowest: float = 0.0
    virtual_seconds: float = 0.0

    def add(self, other: "Tally") -> None:
        """Take in another run."""
        for name in (
            "transactions",
            "questions",
            "broadcasts",
            "abandoned",
            "other_clients",
            "wrong_count",
            "virtual_seconds",
        ):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("injected", "outcomes", "events", "counts"):
            getattr(self, name).update(getattr(other, name))
        self.wrong += other.wrong
        self.slowest = max(self.slowest, other.slowest)

    @property
    def _share_answered(self) -> float:
        """How many of the requests without a fault were answered with data."""
        return self.outcomes[Fault.NONE, "right data"] / max(self.injected[Fault.NONE], 1)

    def complain(self, text: str) -> None:
        """Something was wrong or lost."""
        self.wrong_count += 1
        if len(self.wrong) < 20:
            self.wrong.append(text)

    def __str__(self) -> str:
        columns = ("right data", "device's exception", "0B", "06", "0A", "WRONG")
        rows = [_row("fault", "injected", columns)]
        of_lines = [*(each.value for each in Fault), "(not sent)"]
        for fault in of_lines + sorted(set(self.injected) - set(of_lines)):
            cells = [self.outcomes[fault, column] for column in columns]
            if self.injected[fault] or any(cells):
                rows.append(_row(fault, self.injected[fault] or "", cells))
        totals = [sum(count for (_, name), count in self.outcomes.items() if name == column) for column in columns]
        rows.append(_row("all", self.injected.total(), totals))
        faults = self.injected.total() - self.injected[Fault.NONE]
        rows += [
            "",
            f"{self.questions} requests of clients, {self.abandoned} of which they left; {self.broadcasts} broadcasts",
            f"{self.transactions} transactions on lines, {faults} of them with a fault",
            f"{self.other_clients} of other clients; {self._share_answered:.1%} of ours without a fault were answered",
            "lines: " + ", ".join(f"{name} {count}" for name, count in sorted(self.counts.items()) if count),
            "events: " + ", ".join(f"{name} {count}" for name, count in sorted(self.events.items())),
            f"{self.virtual_seconds:.0f} s of the lines' time; slowest answer {1000 * self.slowest:.0f} ms",
            f"wrong or lost: {self.wrong_count}",
        ]
        return "\n".join(rows)


def _row(fault: str, injected: object, cells: Sequence[object]) -> str:
    right, exception, *codes = cells
    return f"{fault:28}{injected:>10}{right:>12}{exception:>20}" + "".join(f"{code:>9}" for code in codes)
