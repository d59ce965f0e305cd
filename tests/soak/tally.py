"""What came of a soak: faults, outcomes, events and counts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gateway.events import Event, PartFailed
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

    def complain(self, text: str) -> None:
        """Something was wrong or lost."""
        self.wrong_count += 1
        if len(self.wrong) < 20:
            self.wrong.append(text)

    def take_events(self, events: list[Event]) -> None:
        """Count them, and take them off the list."""
        for event in events:
            self.events[event.name] += 1
            if isinstance(event, PartFailed):
                self.complain(f"a defect: {event.error}\n{event.traceback}")
        events.clear()

    def __str__(self) -> str:
        columns = ("right data", "device's exception", "0B", "06", "0A", "WRONG")
        kinds = [*(each.value for each in Fault), "(not sent)"]
        kinds += sorted({*self.injected, *(kind for kind, _ in self.outcomes)}.difference(kinds))
        rows = [_row("fault, or question", "injected", columns)]
        for kind in kinds:
            cells = [self.outcomes[kind, column] for column in columns]
            if self.injected[kind] or any(cells):
                rows.append(_row(kind, self.injected[kind] or "", cells))
        totals = [sum(count for (_, name), count in self.outcomes.items() if name == column) for column in columns]
        rows.append(_row("all", self.injected.total(), totals))
        faults = self.injected.total() - self.injected[Fault.NONE]
        rows += [
            "",
            f"{self.questions} requests of clients, {self.abandoned} of which they left; {self.broadcasts} broadcasts",
            f"{totals[0] / max(self.questions, 1):.1%} of them got data",
            f"{self.transactions} transactions on lines, {faults} of them with a fault; {self.other_clients} of others",
            "lines: " + _listed(self.counts),
            "events: " + _listed(self.events),
            f"{self.virtual_seconds:.0f} s of the lines' time; slowest answer {1000 * self.slowest:.0f} ms",
            f"wrong or lost: {self.wrong_count}",
        ]
        return "\n".join(row for row in rows if not row.endswith(": "))


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()) if count)


def _row(fault: str, injected: object, cells: Sequence[object]) -> str:
    right, exception, *codes = cells
    return f"{fault:28}{injected:>10}{right:>12}{exception:>20}" + "".join(f"{code:>9}" for code in codes)
