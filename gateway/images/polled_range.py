"""What a mirror knows of one range that it polls: how old its values are, and whether a poll is in progress.

Order is counted in writes: `writes` is always how many writes to the device have ended so far. An answer shows all that
had ended when its poll was asked. Of those that ended later it may show nothing, because requests may go to the device
side by side.
"""

from gateway.images.polls import Poll
from gateway.modbus.pdu import Span


class PolledRange:
    """A run of addresses that is polled. Its values are not known at first."""

    def __init__(self, poll: Poll, due_at: float) -> None:
        self.poll = poll
        self.due_at = due_at
        #: Its poll is in progress; reads wait for that while nothing is known; the device has refused it.
        self.is_asked = False
        self.is_awaited = True
        self.is_refused = False
        self._asked_at = 0.0
        self._sampled_at: float | None = None
        # The writes that had ended when the present poll was asked, when the last answered one was, and with the last
        # one that may have changed the values.
        self._asked_after = 0
        self._sampled_after = 0
        self._changed_by = 0

    @property
    def span(self) -> Span:
        """Its addresses."""
        return Span(self.poll.area, self.poll.first, self.poll.last + 1 - self.poll.first)

    def asked(self, now: float, writes: int) -> None:
        """Its poll is in progress."""
        self.is_asked, self._asked_at, self._asked_after = True, now, writes

    def answered(self) -> None:
        """Its poll was answered: the values are as old as the question."""
        self.is_asked = self.is_refused = False
        self._sampled_at, self._sampled_after = self._asked_at, self._asked_after

    def failed(self) -> None:
        """Its poll was not answered, or not sent: nobody waits for the next one."""
        self.is_asked = self.is_awaited = False

    def changed(self, now: float, writes: int) -> None:
        """The last write may have changed its values: they are not known until its next poll, which is due."""
        self._changed_by = writes
        self.is_awaited = True
        self.due_at = now

    def touches(self, span: Span | None) -> bool:
        """Whether it has an address of `span`; None stands for every address."""
        poll = self.poll
        return span is None or (poll.area is span.area and poll.first < span.end and span.start <= poll.last)

    def is_known(self, writes: int) -> bool:
        """Whether its values show all of the first `writes` writes."""
        return self._sampled_at is not None and self._sampled_after >= min(self._changed_by, writes)

    def is_lost(self, now: float, stale: float, writes: int) -> bool:
        """Whether its values are too old at `now`, or unknown with nothing better on its way."""
        if self._sampled_at is None or not self.is_known(writes):
            return not self.is_awaited
        return now - self._sampled_at > stale

    def age(self, now: float) -> float | None:
        """How old its values are, in seconds; None while they are not known."""
        if self._sampled_at is None or not self.is_known(self._changed_by):
            return None
        return now - self._sampled_at
