"""What a mirror knows of one range that it polls: how old its values are, and whether a poll is under way."""

from gateway.images.polls import Poll
from gateway.modbus.pdu import Span


class PolledRange:
    """A run of addresses that is polled. `sampled_at` is None while its values are not known."""

    def __init__(self, poll: Poll, due_at: float) -> None:
        self.poll = poll
        self.due_at = due_at
        self.asked_at = 0.0
        self.sampled_at: float | None = None
        #: Its poll is under way; reads wait for that while nothing is known; the device has refused it.
        self.is_asked = False
        self.is_awaited = True
        self.is_refused = False

    @property
    def span(self) -> Span:
        """Its addresses."""
        return Span(self.poll.area, self.poll.first, self.poll.last + 1 - self.poll.first)

    def asked(self, now: float) -> None:
        """Its poll is under way."""
        self.is_asked, self.asked_at = True, now

    def answered(self) -> None:
        """Its poll was answered: the values are as old as the question."""
        self.is_asked = self.is_refused = False
        self.sampled_at = self.asked_at

    def failed(self) -> None:
        """Its poll was not answered, or not sent: nobody waits for the next one."""
        self.is_asked = self.is_awaited = False

    def touches(self, span: Span | None) -> bool:
        """Whether it has an address of `span`; None stands for every address."""
        poll = self.poll
        return span is None or (poll.area is span.area and poll.first < span.end and span.start <= poll.last)

    def is_lost(self, now: float, stale: float) -> bool:
        """Whether its values are too old at `now`, or unknown with nothing better on its way."""
        return not self.is_awaited if self.sampled_at is None else now - self.sampled_at > stale

    def must_be_asked(self, now: float) -> None:
        """Its values may have changed: they are not known until its next poll, which is due."""
        self.sampled_at = None
        self.is_awaited = True
        self.due_at = now

    def age(self, now: float) -> float | None:
        """How old its values are, in seconds; None while they are not known."""
        return None if self.sampled_at is None else now - self.sampled_at
