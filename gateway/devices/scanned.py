"""A unit that may not be there, for the questions of a scan."""

from collections.abc import Callable

from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.frame import Frame
from gateway.timing.budget import AnswerTime


class ScannedUnit(Destination):
    """`heard` are its answers to the last question, in time or late, each with how many seconds it took."""

    def __init__(self, unit: int, answer_time: AnswerTime, now: Callable[[], float]) -> None:
        super().__init__(unit, f"unit {unit} of a scan", answer_time)
        self.heard: list[tuple[Frame, float]] = []
        self._now = now

    def finished(self, transaction: Transaction, response: Frame | None) -> None:
        """See Destination."""
        if response is not None:
            self.heard.append((response, self._now() - transaction.ends_at))
