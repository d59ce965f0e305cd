"""What comes from a line: scanned once, attributed, and what that means for the request under way.

    bytes ──`modbus.scan`──▶ frames, each with its place ──`attribution`──▶ whose each one is ──here──▶ an outcome

Between `begin` and an outcome, or `conclude`, one request is under way.
"""

from enum import Enum, auto
from typing import Final, NamedTuple

from gateway.errors import AmbiguousResponse, RequestError
from gateway.lines.attribution import Attribution, ForeignRequest, Owner
from gateway.lines.echo import EchoDetector
from gateway.lines.late import LateWindows, Question
from gateway.lines.pacing import Pace
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import MAX_ASCII_ADU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import KNOWN_FUNCTIONS, response_size
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.modbus.scan import Expected, Scanner, Token
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import RtuScanner
from gateway.timing.budget import AnswerTime, Budget

#: So many bytes and frames are kept to tell what was heard before an answer or instead of one.
_BYTES: Final = 1024
_FRAMES: Final = 64

#: What has come of a request: its answer, or one that may be another's; None as long as nothing has.
Outcome = Frame | AmbiguousResponse | None


class Verdict(Enum):
    """What has come instead of an answer, in one word."""

    #: Nothing came, or only answers to older requests.
    NOTHING = auto()
    #: What was sent came back, and nothing else.
    ECHO = auto()
    #: Only whole frames came, of other units or other clients: the unit that was asked has said nothing.
    FRAMES = auto()
    #: There is more: it may be an answer that was damaged.
    BROKEN = auto()


class Instead(NamedTuple):
    """What has come instead of an answer. `text` is none if that explains itself: late answers, one that came early."""

    verdict: Verdict
    text: bytes


#: What has come instead of a request that was not sent.
NOTHING: Final = Instead(Verdict.NOTHING, b"")


class LateResponse(NamedTuple):
    """A response that came after its limit."""

    question: Question
    frame: Frame


class Receiver:
    """Hears one line.

    `came_late` are answers to older requests; the caller takes them out. `damaged_at` is when silence will have shown
    that what came is the answer with a wrong check sum, None unless it looks so.
    """

    def __init__(self, settings: LineSettings, windows: LateWindows, echo: EchoDetector, report: Report) -> None:
        is_ascii = settings.timing.mode == "ascii"
        self.came_late: list[LateResponse] = []
        self.damaged_at: float | None = None
        self._windows = windows
        self._echo = echo
        self._report = report
        self._budget = Budget(settings.timing, 0.0)
        self._silence = 0.0
        self._scanner: Scanner = AsciiScanner() if is_ascii else RtuScanner()
        self._attribution = Attribution(windows, self._patience)
        self._pace = Pace(MAX_ASCII_ADU if is_ascii else MAX_RTU_ADU)
        #: What is under way, and from where on it is; the first bytes that have come since, and frames that are not its
        #: answer; or, while nothing is, the frames that came last.
        self._current: Transaction | None = None
        self._began_at = 0
        self._text = bytearray()
        self._heard: list[tuple[Token, Owner]] = []

    def tune(self, budget: Budget, silence: float, *, virtual: bool) -> None:
        """So many seconds of silence end a frame of unknown size. A `virtual` port carries bytes at once."""
        self._budget = budget
        self._silence = self._scanner.silence = silence
        self._echo.is_virtual = virtual
        self._pace.tune(budget.line.character, silence, virtual=virtual)

    def begin(self, transaction: Transaction, now: float) -> bytes:
        """The request goes on the line. Its frame."""
        echo, scanner = self._echo, self._scanner
        transaction.expected = Expected(transaction.answers_from, transaction.asked, scanner.position)
        # Another client's copy takes as long as our request, and cannot begin before that has left.
        soon = min(self._silence, transaction.ends_at - now)
        echo_until = 0.0 if echo.is_virtual else transaction.ends_at + soon
        self._attribution.begin(transaction, now, scanner.position, echo_until, echoes=echo.echoes)
        echo.heard_in_a_row(self._attribution.echoes_in_a_row, transaction)
        sent = scanner.encode(transaction.unit, transaction.asked.data)
        self._pace.begin()
        if transaction.expects_answer:
            scanner.expect(transaction.expected, sent, echoes=echo.is_configured)
            self._current = transaction
            self._began_at = scanner.position
            self._text.clear()
            self._heard.clear()
            self.damaged_at = None
        return sent

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> Outcome:
        """Take bytes. Nothing that began in `early` ones is the answer: the request had not arrived."""
        scanner, current = self._scanner, self._current
        self._follow_windows()
        if current is None:
            self._pace.came_idle(len(data), now)
            self._heard.clear()
            return self._attribute(scanner.received(data, now, damaged=damaged))
        if not early:
            self._pace.came(len(data), now)
        if len(self._text) < _BYTES:
            self._text += data
        outcome = self._attribute(scanner.received(data, now, damaged=damaged, early=early))
        self.damaged_at = now + self._silence if outcome is None and self._is_damaged(current) else None
        return outcome

    def tick(self, now: float) -> Outcome:
        """Let time pass."""
        self._follow_windows()
        return self._attribute(self._scanner.tick(now))

    def deadline(self) -> float | None:
        """When silence ends the answer, if it is of unknown size and has begun."""
        return None if self._current is None else self._scanner.deadline(self._current.expected)

    def late_deadline(self) -> float | None:
        """When silence ends a late answer."""
        deadlines = [self._scanner.deadline(expected) for expected in self._windows.expected()]
        return min((each for each in deadlines if each is not None), default=None)

    def look_at(self, now: float) -> float | None:
        """When to look at the line again: nothing that comes before decides anything. None: at the next byte."""
        if self._current is None:
            return self._pace.look_at_idle(now)
        return self._pace.look_at(self._scanner.missing, now)

    def spoken(self, units: set[int]) -> set[int]:
        """Those of `units` that have sent a frame, while nothing was asked, which the bytes that came last complete.

        In lasting noise no frame of unknown size is looked for.
        """
        frames = [token.frame for token, _ in self._heard]
        if not self._pace.is_noisy:
            frames += self._scanner.ended_by_silence(units)
        return {frame.unit for frame in frames if frame.unit in units and _is_response(frame)}

    def conclude(self) -> Instead:
        """The answer has not come in time: find out what has come instead, and tell what follows from it."""
        current = self._current
        if current is None:
            return NOTHING
        self.stop()
        copies = [token for token, _ in self._heard if _is_copy(token, current)]
        others = [token for token, owner in self._heard if owner != "a late answer" and token not in copies]
        text = bytes(self._text)
        if self._echo.is_configured and copies:
            echo = copies.pop(0)
            text = text[: echo.start - self._began_at] + text[echo.end - self._began_at :]
        is_early = self._came_too_early(current, copies, others)
        if is_early:
            self._echo.answered_too_early(current)
        self._notice_echo(current)
        if self._unexplained(self._scanner.position):
            verdict = Verdict.BROKEN
        elif others:
            verdict = Verdict.FRAMES
        else:
            verdict = Verdict.ECHO if copies else Verdict.NOTHING
        return Instead(verdict, b"" if is_early or verdict is Verdict.NOTHING else text)

    def stop(self) -> None:
        """Nothing is awaited any more, but late answers."""
        self._attribution.end(self._scanner.position)
        for token in self._scanner.end():
            self._note(token, self._attribution.owner(token))
        self._current = None

    def has_answered_badly(self, now: float) -> bool:
        """Whether what was heard is the answer, damaged: then it is not owed any more."""
        return self.damaged_at is not None and now >= self.damaged_at

    def may_be_others(self, transaction: Transaction) -> bool:
        """Whether another client waits for an answer of the unit that was asked."""
        return self._attribution.may_be_others(transaction)

    def may_have_collided(self, unit: int, text: bytes, now: float) -> bool:
        """Whether a late answer of another unit has come since the request, or begins in `text`."""
        if any(owner == "a late answer" and token.frame.unit != unit for token, owner in self._heard):
            return True
        return any(self._scanner.has_begun(text, head) for head in self._windows.heads_of_others(unit, now))

    def foreign_requests(self) -> list[ForeignRequest]:
        """What other clients have asked and nobody has answered yet."""
        return list(self._attribution.unanswered())

    def expected(self, unit: int | None, asked: RequestPdu) -> Expected:
        """What an answer looks like that has not begun yet."""
        return Expected(unit, asked, self._scanner.position)

    def _follow_windows(self) -> None:
        """Tell the scanner which late answers may come."""
        if self._windows.windows or self._scanner.late:
            self._scanner.late = self._windows.expected()

    def _attribute(self, tokens: list[Token]) -> Outcome:
        """Find out whose these frames are, all of them: none can answer a request that is sent later."""
        answer: Token | None = None
        for token in tokens:
            owner = self._attribution.owner(token)
            if owner == "the request":
                answer = token
            else:
                self._note(token, owner)
        current = self._current
        if current is None or not (answer or self._attribution.doubts):
            return None
        return self._finish(current, answer)

    def _note(self, token: Token, owner: Owner) -> None:
        """A frame that is not the answer."""
        if owner == "a late answer":
            self.came_late.append(LateResponse(self._attribution.late, token.frame))
        elif self._current is not None and not (token.is_damaged or _is_copy(token, self._current)):
            self._report.foreign(token.frame, self._current)
        if len(self._heard) < _FRAMES:
            self._heard.append((token, owner))

    def _finish(self, current: Transaction, answer: Token | None) -> Outcome:
        """An answer has come. It is ambiguous when another client's request may have got it."""
        self._echo.answered()
        self.stop()
        end = self._scanner.position if answer is None else answer.start
        if self._heard or end > current.expected.since:
            current.counts.noise += self._unexplained(end) > 0
            self._notice_echo(current)
        doubts = self._attribution.doubts
        if answer is not None and not doubts:
            return answer.frame
        self._report.other_client(current, doubts[0].frame)
        return AmbiguousResponse()

    def _unexplained(self, end: int) -> int:
        """How many bytes have come since the request, up to this place, that are no part of a frame."""
        at, count = self._began_at, 0
        for token in sorted((token for token, _ in self._heard if not token.is_damaged), key=_start):
            if at <= token.start < end:
                count += token.start - at
                at = token.end
        return count + max(0, end - at)

    def _is_damaged(self, current: Transaction) -> bool:
        """Whether all that has come is, for what can be seen, the answer with a wrong check sum.

        While another answer is late, or another client awaits one, it may be that, with a damaged unit identifier.
        While one to an earlier sending is, it may be that one.
        """
        if self._windows.windows or current.owed > 1 or self._attribution.foreign or self._attribution.doubts:
            return False
        begin = current.expected.since - self._began_at
        if begin and not self._echo.is_configured:
            return False  # what came early may have been another client's request
        if not self._scanner.is_damaged(bytes(self._text[begin:]), current.expected):
            return False
        sound = [token for token, _ in self._heard if not token.is_damaged]
        return begin == sum(token.end - token.start for token in sound if _is_copy(token, current)) and all(
            _is_copy(token, current) for token in sound
        )

    def _came_too_early(self, current: Transaction, copies: list[Token], others: list[Token]) -> bool:
        """Whether the answer has come, but began before all of the request can have left.

        A copy of the request that can be its answer is taken for an echo, until the port is known to have no wire.
        """
        since, asked = current.expected.since, current.asked
        if self._echo.is_configured or since == self._began_at:
            return False
        if self._echo.has_no_wire and copies and copies[0].start < since and asked.accepts(asked.data):
            return True
        return any(current.accepts(token.frame) for token in others)

    def _notice_echo(self, current: Transaction) -> None:
        """A copy of what was sent that comes before all of it has left is the adapter's."""
        since = current.expected.since
        if any(token.start < since and _is_copy(token, current) for token, _ in self._heard):
            self._echo.heard(current)

    def _patience(self, asked: RequestPdu, answer_time: AnswerTime) -> float:
        """How long after another client has asked this its answer may come: as to us."""
        limit = self._budget.limit(asked, answer_time)
        return limit + self._windows.length(limit, answer_time)


def _start(token: Token) -> int:
    return token.start


def _is_copy(token: Token, sent: Transaction) -> bool:
    """Whether it is what was sent."""
    return token.frame == (sent.unit, sent.asked.data)


def _is_response(frame: Frame) -> bool:
    """Whether nobody but its unit can have sent `frame`: a request to it may look like its response."""
    if response_size(frame.pdu) not in {0, len(frame.pdu)}:
        return False
    try:
        return parse_request(frame.pdu).function not in KNOWN_FUNCTIONS
    except RequestError:
        return True
