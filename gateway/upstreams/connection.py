"""The connection to another server: when the next request may be sent on it, and when it is closed for none.

- **Silence**: `gap` seconds pass after a request is over, answered or not, and after any response, before the next.
- **Identifier 0**: a server that answers with it does not say which request it answers. So after a time-out, after
  anything received but the one response, and after a request without a response, the connection is `is_spoilt`: the
  next request has a new one, on which no earlier response can come (ADR 6).
- **Idle**: after `idle` seconds without a request it is not needed.
"""

from collections.abc import Callable
from math import inf

from gateway.lines.transaction import Transaction
from gateway.upstreams.settings import UpstreamSettings

#: Sends a request with its transaction identifier.
Send = Callable[[int, Transaction], None]
#: Delivers what has arrived and was not read yet, and tells if the connection has ended.
Look = Callable[[], None]


def see_nothing() -> None:
    """Do nothing: there is no connection to read from."""


class Connection:
    """The connection, closed at first. `send` is None while it is closed; `look` is called before sending."""

    def __init__(self, settings: UpstreamSettings) -> None:
        self.send: Send | None = None
        self.look: Look = see_nothing
        self.is_spoilt = False
        #: Whether no request is over yet on it.
        self.is_unused = True
        self._gap = settings.gap
        self._idle = settings.idle
        self._is_zero = settings.transaction_id == "zero"
        #: When the last request was over, and when the next one may be sent.
        self._used_at = 0.0
        self._free_at = 0.0

    def open(self, send: Send, look: Look, now: float) -> None:
        """Use this connection from now on."""
        self.send = send
        self.look = look
        self.is_spoilt = False
        self.is_unused = True
        self._used_at = now

    def close(self) -> None:
        """Use it no more."""
        self.send = None
        self.look = see_nothing

    def rest(self, now: float) -> None:
        """Note that a request is over."""
        self.is_unused = False
        self._used_at = now
        self.be_silent(now)

    def be_silent(self, now: float) -> None:
        """Note that something has come: the silence begins anew."""
        if self._gap:  # `now` may be later than that of the request for which it was read
            self._free_at = now + self._gap

    def spoil(self) -> None:
        """Note that a response may come, or has come, that could be taken for that to the next request."""
        self.is_spoilt = self._is_zero

    def is_free(self, now: float) -> bool:
        """Tell whether a request may be sent on it."""
        return self.send is not None and now >= self._free_at and not self.is_spoilt

    def free_at(self) -> float:
        """Return when the silence ends in which nothing may be sent; infinity if nothing can be sent after it."""
        return self._free_at if self._gap and self.send is not None else inf

    def leaves_at(self) -> float:
        """Return when it is closed, if no request comes; infinity for never."""
        return self._used_at + self._idle if self._idle and self.send is not None else inf
