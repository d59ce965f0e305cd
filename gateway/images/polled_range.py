"""One range that a mirror polls: how old its values are, and whether a poll is in progress.

Order is counted in writes: `writes` is always how many writes to the device have finished. The response to a poll shows
all writes that had finished when the poll was submitted. It may not show later ones, because several requests can be
on the way to the device.
"""

from gateway.images.polls import Poll
from gateway.modbus.pdu import Span


class PolledRange:
    """A range of addresses that is polled. Its values are unknown at first."""

    def __init__(self, poll: Poll, due_at: float) -> None:
        self.poll = poll
        self.due_at = due_at
        #: Its poll is in progress; reads wait for it while the values are unknown; the device has refused it.
        self.is_asked = False
        self.is_awaited = True
        self.is_refused = False
        self._asked_at = 0.0
        self._sampled_at: float | None = None
        # The writes that had finished: when the present poll was submitted, when the last answered one was, and up to
        # the last one that may have changed the values.
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
        """Its poll was answered: the age of the values counts from its submission."""
        self.is_asked = self.is_refused = False
        self._sampled_at, self._sampled_after = self._asked_at, self._asked_after

    def failed(self) -> None:
        """Its poll was not answered, or not sent: reads do not wait for the next one."""
        self.is_asked = self.is_awaited = False

    def changed(self, now: float, writes: int) -> None:
        """The last write may have changed its values: they are unknown until its next poll, which is due."""
        self._changed_by = writes
        self.is_awaited = True
        self.due_at = now

    def touches(self, span: Span | None) -> bool:
        """Whether it contains an address of `span`; None means every address."""
        poll = self.poll
        return span is None or (poll.area is span.area and poll.first < span.end and span.start <= poll.last)

    def is_known(self, writes: int) -> bool:
        """Whether its values include the first `writes` writes."""
        return self._sampled_at is not None and self._sampled_after >= min(self._changed_by, writes)

    def is_lost(self, now: float, stale: float, writes: int) -> bool:
        """Whether its values are stale at `now`, or unknown and no poll is in progress."""
        if self._sampled_at is None or not self.is_known(writes):
            return not self.is_awaited
        return now - self._sampled_at > stale

    def age(self, now: float) -> float | None:
        """How old its values are, in seconds; None while they are unknown."""
        if self._sampled_at is None or not self.is_known(self._changed_by):
            return None
        return now - self._sampled_at
