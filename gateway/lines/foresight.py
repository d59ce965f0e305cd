"""Foresees when a response will be complete, from the last ones of the same unit, function and size.

Until then nobody need look at the port. What that takes, and why no byte from before the end of a request is taken for
its response then: docs/adr/0044-who-foresees-a-response.md
"""

from math import inf
from typing import Final

from gateway.lines.attribution import Attribution
from gateway.lines.echo import EchoDetector
from gateway.lines.exchange import Exchange
from gateway.lines.ledger import Ledger
from gateway.lines.pacing import Pace
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.scan import EXCEPTION_SIZE, Token
from gateway.timing.characters import LineTiming

#: So many kinds of requests are remembered; then all are forgotten.
_MOST: Final = 1024
#: An exception may be seen later by this many bytes of a longer PDU.
_LATEST_EXCEPTION: Final = 20
#: It is looked for so many characters before its end: the last one is read as it comes.
_EARLIER: Final = 0.75
#: After a later response the next one is expected later by this share of a character at most. By more, a device that
#: answers in its own cycle would often be sooner than expected, and be seen late.
_LATER: Final = 1 / 8
#: So many seconds after anything that was no response to a request nothing is foreseen: more of it may come.
CALM: Final = 60.0


class Habit:
    """When the responses of one kind are complete, in seconds after the end of their requests: the early ones."""

    __slots__ = ("_sooner", "after", "is_usual")

    def __init__(self, after: float) -> None:
        self.after = after
        #: Whether the last response was normal, and came about when it was expected.
        self.is_usual = True
        self._sooner = 0.0

    def came(self, after: float, wire_time: float, character: float) -> None:
        """Note that a response, whose characters take `wire_time`, was seen to be completed."""
        late = after - self.after
        self.is_usual = late < wire_time
        self._sooner = 0.0
        self.after += min(late, _LATER * character)

    def was_there(self, character: float) -> None:
        """Note that a response was complete when it was looked for: perhaps for long. Look sooner each time."""
        self.is_usual = True
        self._sooner = 2 * self._sooner or character
        self.after -= self._sooner


class Foresight:
    """The habits of the units of one line. It sets when `pace` lets the port be looked at."""

    def __init__(self, ledger: Ledger, attribution: Attribution, echo: EchoDetector, pace: Pace) -> None:
        self._ledger = ledger
        self._attribution = attribution
        self._echo = echo
        self._pace = pace
        self._habits: dict[int, Habit] = {}
        #: From when on responses are foreseen again.
        self._calm_at = 0.0

    @property
    def has_habits(self) -> bool:
        """Whether any response may be foreseen."""
        return bool(self._habits)

    def is_undisturbed(self, position: int, now: float) -> bool:
        """Tell whether the last request was answered, only responses come, and nothing else is expected."""
        last = self._ledger.last
        return (
            last is not None
            and last.is_answered
            and last.end_place == position
            and not (self._ledger.late or self._ledger.heard or self._echo.echoes)
            and now >= self._calm_at
            and self._attribution.is_alone(now)
        )

    def disturbed(self, now: float) -> None:
        """Note that something else than a response was received: look for each byte."""
        self._calm_at = now + CALM
        self._pace.foresee_nothing()

    def begin(self, ours: Exchange, timing: LineTiming) -> None:
        """Foresee the response to a request that is sent on an undisturbed line, if the last one was as usual."""
        habit = self._habits.get(_kind(ours))
        if habit is None or not habit.is_usual:
            return
        habit.is_usual = False
        size = ours.asked.response_size
        if size is None or timing.mode == "ascii" or not _is_plain(ours):
            return
        ends_at = ours.asked_at + habit.after - _EARLIER * timing.character
        longer = size - EXCEPTION_SIZE
        begun_at = ends_at if longer <= _LATEST_EXCEPTION else ends_at - timing.frame(longer) + timing.frame(0)
        self._pace.foresee(-inf if self._echo.is_virtual else ours.asked_at, begun_at, ends_at)

    def answered(self, ours: Exchange, token: Token, timing: LineTiming) -> None:
        """Note the response to a request, which came alone."""
        after, pdu = token.at - ours.asked_at, token.frame.pdu
        wire_time = timing.frame(len(pdu))
        keeps_pace = after >= wire_time - timing.character and not self._ledger.is_connected
        if not keeps_pace or pdu[0] & EXCEPTION_BIT:
            return
        kind = _kind(ours)
        habit = self._habits.get(kind)
        if habit is None:
            if len(self._habits) >= _MOST:
                self._habits.clear()
            self._habits[kind] = Habit(after)
        elif self._pace.was_there:
            habit.was_there(timing.character)
            self.disturbed(token.at)  # it was read late, perhaps as this machine is: that costs the line's time
        else:
            habit.came(after, wire_time, timing.character)

    def forget(self) -> None:
        """Forget all habits: the line has changed."""
        self._habits.clear()


def _kind(ours: Exchange) -> int:
    """Return the number of a unit, a function and a size."""
    asked = ours.asked
    return (ours.unit << 8 | asked.function) << 9 | asked.longest_response


def _is_plain(ours: Exchange) -> bool:
    """Tell whether it is a read of one unit, sent once, whose response cannot be an echo of it."""
    asked = ours.asked
    is_single = ours.owed == 1 and not ours.sender.is_repeat
    is_known = ours.answers_from is not None and asked.response_size != len(asked.data)
    return asked.only_reads and is_single and is_known
