"""What comes from a line, and what it means: the answer to the one request on it, echoes, other clients, noise.

The framer finds what looks like the answer. All that was heard is kept beside it until then, because what came before
an answer says whether it can be believed.
"""

from collections.abc import Iterable
from typing import Final

from gateway.errors import AmbiguousResponse
from gateway.lines.echo import Echo
from gateway.lines.overheard import has_begun, is_from, overheard, requests_in
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.transaction import Transaction
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.frame import Frame, ResponseFramer
from gateway.modbus.rtu import ResponseFramer as RtuFramer

#: So much is kept of what was heard.
_SIZE: Final = 1024
#: Bytes on an idle line belong together if no more seconds part them: longer than a hole inside an ASCII frame.
_FRESH: Final = 1.0

#: What has come of a request: its answer, or one that may be another's; None as long as nothing has.
Outcome = Frame | AmbiguousResponse | None


class Hearing:
    """Listens to one line. Between `begin` and the next one there is one request whose answer is sought.

    `late` are answers to older requests that have come since: they have their own receivers. `echo_suspected` says
    that the adapter was caught returning what is sent. `deadline` is when silence ends a response of unknown size.
    """

    def __init__(self, settings: LineSettings, report: Report) -> None:
        self.late: list[Frame] = []
        self.echo_suspected = False
        self._mode = settings.timing.mode
        self._report = report
        self._echo = Echo() if settings.echo else None
        self._silence = 0.0
        self._is_virtual = True
        self._listen_anew()
        self._current: Transaction
        self._sent = b""
        self._asked = b""
        #: What came before all of the request can have left, so that it can be no answer; and what came since.
        self._early = bytearray()
        self._heard = bytearray()
        #: Whether other frames came since that are no answer.
        self._foreign = False
        self._idle = bytearray()
        self._idle_at = 0.0
        #: Other clients' requests and when they came, and those from so shortly before that they may be answered now.
        self._strangers: list[tuple[float, Frame]] = []
        self._near_strangers: tuple[Frame, ...] = ()

    def tune(self, silence: float, *, virtual: bool) -> None:
        """So many seconds of silence end a frame of unknown size. A `virtual` port carries bytes at once."""
        self._silence = silence
        self._is_virtual = virtual
        self._listen_anew()

    def begin(self, transaction: Transaction, now: float) -> bytes:
        """The request goes on the line: forget what is older, unless other clients may still be answered. Its frame."""
        if transaction.expects_answer:
            self._forget(now, transaction.limit)
            self._current = transaction
            self._framer.expect(transaction.answers_from, transaction.asked)
        self._asked = transaction.asked.data
        self._sent = self._framer.encode(transaction.unit, self._asked)
        if self._echo is not None:
            self._echo.expect(self._sent)
        return self._sent

    def received(self, data: bytes, now: float) -> Outcome:
        """Take bytes that may belong to the answer."""
        if self._echo is not None:
            data = self._echo.strip(data)
            self._early[:] = self._echo.before
        if len(self._heard) < _SIZE:
            self._heard += data
        return self._judge(self._framer.received(data, now), now)

    def received_early(self, data: bytes) -> None:
        """Take bytes that came before all of the request can have left."""
        if len(self._early) < _SIZE:
            self._early += data

    def received_idle(self, data: bytes, now: float) -> None:
        """Take bytes that came while nothing was asked."""
        if now - self._idle_at > _FRESH:
            self._idle.clear()
        self._idle += data
        del self._idle[:-_SIZE]
        self._idle_at = now

    def is_idle_from(self, unit: int) -> bool:
        """Whether a frame from `unit` has come while nothing was asked."""
        return is_from(unit, self._mode, bytes(self._idle))

    def tick(self, now: float) -> Outcome:
        """Let time pass."""
        return self._judge(self._framer.tick(now), now)

    def conclude(self) -> None:
        """The answer has not come in time."""
        for frame in self._framer.conclude():
            self._is_foreign(frame)
        self._notice_echo(self.instead().find(self._sent))

    def instead(self) -> bytes:
        """What was heard instead of an answer: everything but late answers to older requests."""
        heard = bytes(self._early + self._heard)
        for frame in self.late:
            heard = heard.replace(self._framer.encode(*frame), b"")
        return heard

    def is_the_request(self, heard: bytes) -> bool:
        """Whether `heard` is what was sent, and nothing else."""
        return heard == self._sent

    def has_begun(self) -> bool:
        """Whether the answer has begun to come."""
        transaction = self._current
        head = transaction.asked.response_head
        expected = head if transaction.answers_from is None else bytes((transaction.answers_from,)) + head
        return has_begun(self._mode, self.instead().replace(self._sent, b""), expected)

    def lost(self, heard: bytes, now: float) -> None:
        """The request has failed; this was heard instead of its answer."""
        self._keep_strangers(requests_in(self._mode, heard.replace(self._sent, b"")), now)

    def hand_over(self) -> ResponseFramer:
        """The framer that looks for the answer, for those who go on looking."""
        framer = self._framer
        self._listen_anew()
        return framer

    def _listen_anew(self) -> None:
        self._framer: ResponseFramer = AsciiFramer() if self._mode == "ascii" else RtuFramer(self._silence)
        self.deadline = self._framer.deadline

    def _forget(self, now: float, limit: float) -> None:
        """A request begins that is answered within `limit`, as those of others are."""
        if self._idle:
            requests = requests_in(self._mode, bytes(self._idle))
            # a copy of what was asked last is an answer, not a stranger's
            self._keep_strangers((frame for frame in requests if frame.pdu != self._asked), self._idle_at)
            self._idle.clear()
        if self._strangers or self._near_strangers:
            self._strangers = [(at, frame) for at, frame in self._strangers if now - at <= limit]
            self._near_strangers = tuple(frame for _, frame in self._strangers)
        self.late.clear()
        self._early.clear()
        self._heard.clear()
        self._foreign = False

    def _judge(self, frames: list[Frame], now: float) -> Outcome:
        """The first frame that is the answer; others are dropped.

        All frames were received before anything else was sent, so none of them can answer the next request.
        """
        answer = None
        for frame in frames:
            if answer is None and self._current.accepts(frame):
                answer = frame
            elif self._is_foreign(frame):
                self._foreign = True
        if answer is None:
            return None
        if self._framer.heard_noise or self._foreign or self._early or self._near_strangers:
            return self._listen_back(answer, now)
        return answer

    def _listen_back(self, answer: Frame, now: float) -> Outcome:
        """Find out what was heard before `answer`; it is ambiguous when another client has asked the same unit."""
        current = self._current
        before = bytes(self._early + self._heard)
        heard = overheard(self._mode, before, self._sent, self._framer.encode(*answer))
        self._notice_echo(heard.echo_at)
        current.counts.noise += heard.has_noise
        for frame in heard.responses:
            handed_over = current.answers_from in (None, frame.unit) and current.asked.accepts(frame.pdu)
            if not handed_over:
                self._is_foreign(frame)
        requests = [frame for frame in heard.requests if frame not in self.late]
        self._keep_strangers(requests, now)
        asked = (current.unit, answer.unit)
        for frame in (*requests, *self._near_strangers):
            if frame.unit in asked:
                self._report.other_client(current, frame)
                return AmbiguousResponse()
        return answer

    def _is_foreign(self, frame: Frame) -> bool:
        """Tell of a frame that is no answer, unless it is a late one to an older request."""
        if frame in self.late:
            return False
        self._report.foreign(frame, self._current)
        return True

    def _notice_echo(self, echo_at: int) -> None:
        """On a real port, remember that the adapter returns what is sent: a copy of it began at `echo_at`, if not -1.

        Only before the request has left is that a proof, if the response can be a copy too.
        """
        asked = self._current.asked
        is_response = echo_at >= len(self._early) and asked.accepts(asked.data)
        if not self._is_virtual and echo_at >= 0 and not is_response:
            self._report.echo(self._current, first=not self.echo_suspected)
            self.echo_suspected = True

    def _keep_strangers(self, requests: Iterable[Frame], now: float) -> None:
        """Other clients have asked this, and may not have their answers yet."""
        self._strangers += [(now, frame) for frame in requests]
