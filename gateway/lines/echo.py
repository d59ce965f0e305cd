"""Adapters that return what they send, and ports without a wire: how a line finds out.

On two-wire lines the receiver may hear the sender. Before all of a request has left, nobody else can copy it: a copy
that comes then is the adapter's, and the config should say `echo = true`. One that comes later may be another client's,
but not one of every request. A right answer that comes so early means that the port has no wire (`wire = "direct"`).
"""

from typing import Final

from gateway.lines.report import Report
from gateway.lines.transaction import Transaction

#: After so many requests in a row of which a copy came back, it is the adapter.
ECHOES: Final = 5
#: After so many answers in a row that came too early, the port is known to have no wire.
EARLY_ANSWERS: Final = 3


class EchoDetector:
    """What is known of a line's adapter: whether it `is_configured` to echo, or `is_suspected` of it."""

    def __init__(self, report: Report, *, is_configured: bool) -> None:
        self.is_configured = is_configured
        self.is_suspected = False
        self.is_virtual = True
        self._report = report
        #: Of how many requests in a row, without one that was answered in time, the answer came too early.
        self._early_answers = 0

    @property
    def echoes(self) -> bool:
        """Whether a copy of a request is the adapter's, whenever it comes."""
        return self.is_configured or self.is_suspected

    @property
    def has_no_wire(self) -> bool:
        """Whether the port is known to have no wire."""
        return self._early_answers >= EARLY_ANSWERS

    def heard_in_a_row(self, count: int, transaction: Transaction) -> None:
        """Of so many requests in a row a copy was heard, up to now."""
        if count >= ECHOES and not self.is_suspected:
            self.heard(transaction)

    def heard(self, transaction: Transaction) -> None:
        """What was sent has come back from the adapter."""
        if not (self.is_virtual or self.has_no_wire or self.is_configured):
            self._report.echo(transaction, first=not self.is_suspected)
            self.is_suspected = True

    def answered(self) -> None:
        """An answer has come in time."""
        self._early_answers = 0

    def answered_too_early(self, transaction: Transaction) -> None:
        """The answer came before all of the request can have left. A connection may be slow, and says nothing."""
        self._early_answers += not self.is_virtual
        self._report.too_early(transaction, proven=self._early_answers == EARLY_ANSWERS)
