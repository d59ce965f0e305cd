"""Detects adapters that echo, and ports without a wire.

On two-wire lines an adapter may receive its own bytes. No other client can copy a request before all of it was sent, so
an early copy comes from the adapter, and the config should say `echo = true`. A later copy may be another client's
request, but not if every request is copied. Valid responses that come so early mean that the port has no wire
(`wire = "direct"`).
"""

from typing import Final

from gateway.lines.telling import Telling
from gateway.lines.transaction import Transaction

#: After copies of this many requests in a row, the adapter echoes.
ECHOES: Final = 5
#: After this many early responses in a row, the port has no wire.
EARLY_ANSWERS: Final = 3


class EchoDetector:
    """The knowledge about a line's adapter: it `is_configured` to echo, or `is_suspected` of it."""

    def __init__(self, telling: Telling, *, is_configured: bool) -> None:
        self.is_configured = is_configured
        self.is_suspected = False
        self.is_virtual = True
        self._telling = telling
        #: Early responses in a row, without one in time between them.
        self._early_responses = 0

    @property
    def echoes(self) -> bool:
        """Whether a copy of a request comes from the adapter, at any time."""
        return self.is_configured or self.is_suspected

    @property
    def has_no_wire(self) -> bool:
        """Whether the port is known to have no wire."""
        return self._early_responses >= EARLY_ANSWERS

    def tune(self, *, virtual: bool) -> None:
        """Set whether the port is `virtual`: there early or repeated bytes prove nothing."""
        self.is_virtual = virtual

    def record_copies(self, count: int, transaction: Transaction) -> None:
        """Note that the last `count` requests in a row were also received as copies."""
        if count >= ECHOES and not self.is_suspected:
            self.record_echo(transaction)

    def record_echo(self, transaction: Transaction) -> None:
        """Note that a copy of the request came from the adapter."""
        if not (self.is_virtual or self.has_no_wire or self.is_configured):
            self._telling.echo(transaction, first=not self.is_suspected)
            self.is_suspected = True

    def record_response(self) -> None:
        """Note that a response came in time."""
        self._early_responses = 0

    def record_early_response(self, transaction: Transaction) -> None:
        """Note a response that came before all of the request can have been sent. A virtual port proves nothing."""
        self._early_responses += not self.is_virtual
        self._telling.too_early(transaction, proven=self._early_responses == EARLY_ANSWERS)
