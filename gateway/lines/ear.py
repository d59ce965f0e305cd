"""Other clients on a line: what they have asked, as long as it may still be answered.

A response does not say who asked. While another client's request to the same unit is unanswered, a response that would
fit ours may be theirs. So every byte is heard, in order, whatever else it is part of: while nothing is asked, while our
own request leaves, before and behind our answer. A request is remembered until a response that fits it is heard, or
until no answer to it can come any more. Each response that is heard counts for one request only.

Copies of our own request are an echo, or the request of another client who asks the same; see `Ear.begin`.
"""

from collections import deque
from collections.abc import Callable
from math import inf, nextafter
from typing import Final, NamedTuple

from gateway.errors import RequestError
from gateway.lines.late import LateWindows
from gateway.lines.transaction import Transaction
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.chartime import Mode
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.passing import PassingFrames
from gateway.modbus.pdu import KNOWN_FUNCTIONS, RequestPdu, parse_request

#: So many requests to one unit are remembered.
_PER_UNIT: Final = 16
#: A request to a unit that is never asked by us is forgotten after so many seconds.
_LONGEST: Final = 300.0
#: So many chunks may wait to be looked at.
_CHUNKS: Final = 256
#: After so many requests in a row of which a copy came back, it is the adapter.
ECHOES: Final = 5


class Stranger(NamedTuple):
    """Another client's request, and when it was heard."""

    at: float
    frame: Frame
    asked: RequestPdu


class Ear:
    """Hears one line. What is heard is looked at by `listen`, or not at all when `skip` says that it is the answer.

    `windows` are those of our own late answers; `patience(asked)` says after how many seconds nothing can answer
    `asked` any more, if the unit is the one that we ask at the moment. `strangers` are the unanswered requests of other
    clients by unit, `doubts` those that the answer to the current request may belong to. `passed` is what was found in
    the bytes that were looked at last.
    """

    def __init__(self, mode: Mode, windows: LateWindows, patience: Callable[[RequestPdu], float]) -> None:
        self.strangers: dict[int, deque[Stranger]] = {}
        self.doubts: list[Stranger] = []
        self.passed: list[Frame] = []
        #: Of how many requests in a row a copy was heard beside the answer.
        self.echoes_in_a_row = 0
        self._windows = windows
        self._patience = patience
        self._cutter = AsciiFramer() if mode == "ascii" else PassingFrames()
        self._heard: list[tuple[float, bytes]] = []
        #: What was asked last, whether its answer is still awaited, and whether it has come.
        self._asked: Transaction | None = None
        self._is_asking = False
        self._is_answered = False
        self._began = self._deaf_until = self._echo_until = 0.0
        #: What was unanswered when it was asked.
        self._before: list[Stranger] = []
        #: Copies of it that were heard beside its answer, and whether one that comes late is an echo.
        self._copies = 0
        self._echoes = False
        self._had_echo = False

    def begin(
        self, transaction: Transaction, now: float, deaf_until: float, echo_until: float, *, echoes: bool
    ) -> None:
        """The request goes on the line; nothing is its answer before `deaf_until`.

        A copy of it is an echo if it can be the response too. Of others the first one is, if it comes before
        `echo_until` or the adapter is known to echo. Otherwise another client asks the same.
        """
        self.echoes_in_a_row = self.echoes_in_a_row + 1 if self._copies else 0
        self._copies = 0
        self._echoes = echoes
        self._had_echo = False
        self._asked = transaction
        self._is_asking = transaction.expects_answer
        self._is_answered = False
        self._began = now
        self._deaf_until = deaf_until
        self._echo_until = echo_until
        if self.doubts:
            self.doubts = []
        if self._before:
            self._before = []
        if self.strangers:
            self._forget(transaction.unit, now)
            self._before = [stranger for strangers in self.strangers.values() for stranger in strangers]

    def deafen(self, now: float) -> float:
        """Nothing that has come up to `now` is the answer. The moment after that."""
        self._deaf_until = nextafter(now, inf)
        return self._deaf_until

    def end(self) -> None:
        """The request is not awaited any more."""
        self._is_asking = False

    def hear(self, data: bytes, now: float) -> None:
        """These bytes came at `now`."""
        self._heard.append((now, data))
        if len(self._heard) > _CHUNKS:
            self.listen()

    def may_doubt(self, transaction: Transaction) -> bool:
        """Whether another client's request may be answered in place of this one, or was."""
        if self.doubts or not self.strangers:
            return bool(self.doubts)
        return transaction.answers_from is None or transaction.unit in self.strangers

    def skip(self) -> None:
        """What was heard since the last look is the answer, and nothing else."""
        self._heard.clear()
        self._is_asking = False

    def listen(self) -> list[Frame]:
        """Look at what was heard since the last time; the responses in it that other clients' requests were given."""
        if not self._heard:
            return []
        heard, self._heard = self._heard, []
        frames = [(frame, at) for at, data in heard for frame in self._cutter.received(data, at)]
        self.passed = [frame for frame, _ in frames]
        return [frame for frame, at in frames if self._is_settled(frame, at)]

    def answered(self, frame: Frame) -> None:
        """This was found to be the answer, whatever else its bytes may have been taken for."""
        if self._asked is not None and not self._is_answered:
            self._is_answered = True
            self.doubts += self._near(frame, self._asked)

    def _is_settled(self, frame: Frame, at: float) -> bool:
        """Take a frame; whether it is the response to another client's request."""
        asked = self._asked
        if asked is not None and self._is_asking and at >= self._deaf_until and asked.accepts(frame):
            near = self._near(frame, asked)
            is_answer, self._is_answered = not (near or self._is_answered), True
            self.doubts += near
            if is_answer:
                return False
        if self._settle(frame):
            return True
        is_ours = asked is not None and self._is_echo(frame, at, asked)
        if not (is_ours or self._windows.awaits(frame)):
            self._remember(frame, at)
        return False

    def _near(self, frame: Frame, asked: Transaction) -> list[Stranger]:
        """Others' requests that `frame` may answer. One for the same as ours, heard since, has the same answer.

        Only the function counts: an exception fits any quantity, and who else asks may ask again for another one.
        """
        sent = asked.unit, asked.asked.data
        function = frame.pdu[0] & ~EXCEPTION_BIT
        return [
            stranger
            for unit in {frame.unit, asked.unit}
            for stranger in self.strangers.get(unit, ())
            if stranger.asked.function == function
            and stranger.at + self._patience(stranger.asked) >= self._began
            and (stranger.frame != sent or stranger in self._before)
        ]

    def _settle(self, frame: Frame) -> bool:
        """Forget the oldest request that `frame` answers; False if there is none.

        Where one of our own late answers may look the same, it may have been that one: then the other is still to come,
        and the window lasts until it cannot come any more.
        """
        strangers = self.strangers.get(frame.unit, ())
        for stranger in strangers:
            asked = stranger.asked
            is_repeated = frame.pdu == asked.data != asked.response_head
            if not is_repeated and asked.accepts(frame.pdu):
                self.strangers[frame.unit].remove(stranger)
                self._drop_empty(frame.unit)
                if self._asked is not None and self._windows.awaits(frame):
                    self._windows.extend(frame, stranger.at + self._patience(asked))
                return True
        return False

    def _is_echo(self, frame: Frame, at: float, asked: Transaction) -> bool:
        """Whether `frame` is what we have sent, a second copy of its answer, or an answer to a broadcast."""
        if frame.pdu != asked.asked.data or asked.unit not in (frame.unit, BROADCAST_UNIT):
            return False
        self._copies += self._is_asking or _is_echo_shaped(asked)
        if _is_echo_shaped(asked):
            return True
        if asked.expects_answer and not self._is_asking:
            return False  # it comes before the answer, or is too late to be told from another client's request
        is_first, self._had_echo = not self._had_echo, True
        return is_first and (self._echoes or at < self._echo_until)

    def _remember(self, frame: Frame, at: float) -> None:
        try:
            asked = parse_request(frame.pdu)
        except RequestError:
            return
        if asked.function in KNOWN_FUNCTIONS:
            self.strangers.setdefault(frame.unit, deque(maxlen=_PER_UNIT)).append(Stranger(at, frame, asked))

    def _forget(self, unit: int, now: float) -> None:
        """Forget what can be answered no more. How long units may take that we do not ask now is not known."""
        for each, strangers in list(self.strangers.items()):
            while (
                strangers and strangers[0].at + (self._patience(strangers[0].asked) if each == unit else _LONGEST) < now
            ):
                strangers.popleft()
            self._drop_empty(each)

    def _drop_empty(self, unit: int) -> None:
        if not self.strangers[unit]:
            del self.strangers[unit]


def _is_echo_shaped(transaction: Transaction) -> bool:
    """Whether a copy of the request can be its response."""
    return transaction.asked.accepts(transaction.asked.data)
