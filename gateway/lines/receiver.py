"""Receives from a line: bytes are scanned once, each frame is attributed, and that may end the request on the line.

bytes ──`modbus.scan`──▶ frames, each with its place ──`attribution`──▶ their owners ──here──▶ an outcome
"""

from math import inf
from typing import Final, Literal, NamedTuple

from gateway.errors import AmbiguousResponse, RequestError
from gateway.lines.attribution import Attribution, Owner
from gateway.lines.echo import EchoDetector
from gateway.lines.exchange import Exchange
from gateway.lines.foresight import Foresight
from gateway.lines.ledger import Ledger
from gateway.lines.pacing import Pace
from gateway.lines.settings import LineSettings
from gateway.lines.telling import Telling
from gateway.modbus.codes import MAX_ASCII_ADU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import KNOWN_FUNCTIONS, response_size
from gateway.modbus.pdu import RequestPdu, parse_sent
from gateway.modbus.scan import Scanner, Token
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import RtuScanner
from gateway.timing.budget import AnswerTime, Budget

#: The most bytes and frames kept to report what was received before a response or instead of one.
_BYTES: Final = 1024
_FRAMES: Final = 64

#: The shortest time of another client's copy of a request, as a share of ours: its clock may be faster.
_SOONEST: Final = 0.9

#: A response after its time limit, and its exchange.
LateResponse = tuple[Exchange, Frame]
#: The response, or an error if it may be another client's; None while neither has come.
Outcome = Frame | AmbiguousResponse | None


class Diagnosis(NamedTuple):
    """What was received instead of a response.

    | verdict   | what was received                                                                     |
    |-----------|---------------------------------------------------------------------------------------|
    | `nothing` | nothing, or only late responses to earlier requests                                   |
    | `echo`    | a copy of the request, and nothing else                                               |
    | `frames`  | only whole frames, of other units or other clients: the unit has sent nothing         |
    | `broken`  | more than that: it may be a damaged response                                          |

    `text` are the bytes; empty if late or early responses explain them.
    """

    verdict: Literal["nothing", "echo", "frames", "broken"]
    text: bytes


#: The diagnosis before anything was sent.
NOTHING: Final = Diagnosis("nothing", b"")


class Receiver:
    """Receives from one line. The ledger's last request is awaited from `begin` until `stop` or `diagnose`.

    The caller takes responses out of `late_responses`. `damaged_at` is when silence will prove that the response came
    with a wrong checksum; None unless it looks so. `silent_at` is when silence ends a frame on the idle line; infinite
    unless it may be from a unit that rests.
    """

    def __init__(self, settings: LineSettings, ledger: Ledger, echo: EchoDetector, telling: Telling) -> None:
        is_ascii = settings.timing.mode == "ascii"
        self.late_responses: list[LateResponse] = []
        self.damaged_at: float | None = None
        self.silent_at = inf
        self.attribution = Attribution(ledger, self._patience)
        self._ledger = ledger
        self._echo = echo
        self._telling = telling
        self._budget: Budget
        self._scanner: Scanner = AsciiScanner() if is_ascii else RtuScanner()
        self._pace = Pace(MAX_ASCII_ADU if is_ascii else MAX_RTU_ADU)
        self._foresight = Foresight(ledger, self.attribution, echo, self._pace)
        #: The first bytes since the request on the line, and the frames that are not its response; on the idle line the
        #: last frames.
        self._text = b""
        self._frames: list[tuple[Token, Owner]] = []
        #: The frames behind the response that came together with it.
        self._behind: list[Token] = []

    def tune(self, budget: Budget, silence: float, *, virtual: bool) -> None:
        """Set the times of the line and the silence that ends a frame of unknown size. See Line.port_up."""
        self._budget = budget
        self._scanner.silence = silence
        self._echo.tune(virtual=virtual)
        self._pace.tune(budget.line.character, silence, virtual=virtual)
        self._foresight.forget()

    @property
    def position(self) -> int:
        """The place of the next byte."""
        return self._scanner.position

    def begin(self, ours: Exchange, now: float) -> bytes:
        """Await the response to our request, which is being sent. Return its frame."""
        echo, scanner, transaction = self._echo, self._scanner, ours.sender
        # Another client's copy takes as long as our request, by its own clock, and cannot begin before ours was sent.
        soon = min(scanner.silence, _SOONEST * (transaction.ends_at - now))
        echo_until = inf if echo.echoes else 0.0 if echo.is_virtual else transaction.ends_at + soon
        is_undisturbed = self._foresight.has_habits and self.is_undisturbed(now)
        self.attribution.begin(ours, scanner.position, echo_until)
        echo.record_copies(self.attribution.echoes_in_a_row, transaction)
        sent = scanner.encode(transaction.unit, transaction.asked.data)
        self._pace.begin()
        if transaction.expects_answer:
            scanner.expect(ours, sent, echoes=echo.is_configured)
            self._text = b""
            self._frames.clear()
            self.damaged_at = None
            if is_undisturbed:
                self._foresight.begin(ours, self._budget.line)
        return sent

    def is_undisturbed(self, now: float) -> bool:
        """Tell whether nothing has come since the last response, and nothing is expected; see Foresight."""
        return self._foresight.is_undisturbed(self._scanner.position, now)

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> Outcome:
        """Take bytes. The response begins after `early` ones: the unit had not received the request."""
        scanner, awaited = self._scanner, self._awaited
        self._follow_ledger()
        if awaited is None:
            self._pace.add_idle(len(data), now)
            self._foresight.disturbed(now)
            self._frames.clear()
            return self._attribute(scanner.received(data, now, damaged=damaged))
        early = early or self._pace.is_early(len(data), now)
        if early:
            self._foresight.disturbed(now)
        else:
            self._pace.add(len(data), now)
        if len(self._text) < _BYTES:
            self._text = self._text + data if self._text else data
        outcome = self._attribute(scanner.received(data, now, damaged=damaged, early=early))
        self.damaged_at = now + scanner.silence if outcome is None and self._is_damaged(awaited) else None
        return outcome

    def tick(self, now: float) -> Outcome:
        """Let time pass."""
        self._follow_ledger()
        return self._attribute(self._scanner.tick(now))

    def deadline(self) -> float | None:
        """Return when silence ends a begun response of unknown size; None if there is none."""
        awaited = self._awaited
        return None if awaited is None else self._scanner.deadline(awaited)

    def late_deadline(self) -> float | None:
        """Return when silence ends a late response; None if it ends none."""
        deadlines = [self._scanner.deadline(late) for late in self._ledger.owed()]
        return min((each for each in deadlines if each is not None), default=None)

    def read_at(self, now: float) -> float | None:
        """Return when to read the port again: no earlier byte decides anything. None: at the next byte."""
        if self._awaited is None:
            return self._pace.read_idle_at(now)
        return self._pace.read_at(self._scanner.missing, now)

    def responding(self, now: float) -> set[int]:
        """Return the units whose responses are complete with the last bytes on the idle line, read at `now`."""
        self.silent_at = now + self._scanner.silence
        return {token.frame.unit for token, _ in self._frames if _is_response(token.frame)}

    def ended_by_silence(self, units: set[int]) -> set[int]:
        """Return those of `units` whose responses, of unknown size, the silence after the last byte completes."""
        self.silent_at = inf
        return {frame.unit for frame in self._scanner.ended_by_silence(units) if _is_response(frame)}

    def diagnose(self) -> Diagnosis:
        """End the request at its time limit, and find out what was received instead of the response."""
        ours = self._awaited
        if ours is None:
            return NOTHING
        self.stop()
        copies = [token for token, _ in self._frames if ours.is_copy(token.frame)]
        others = [token for token, owner in self._frames if owner != "a late response" and token not in copies]
        text = self._text
        if self._echo.is_configured and copies:
            echo = copies.pop(0)
            text = text[: echo.start - ours.place] + text[echo.end - ours.place :]
        is_early = self._came_too_early(ours, copies, others)
        if is_early:
            self._echo.record_early_response(ours.sender)
        self._notice_echo(ours)
        if self._has_noise(ours.place, self._scanner.position):
            return Diagnosis("broken", b"" if is_early else text)
        if not (others or copies):
            return NOTHING
        return Diagnosis("frames" if others else "echo", b"" if is_early else text)

    def stop(self) -> None:
        """End the request: from now on only late responses may come."""
        ours = self._awaited
        if ours is None:
            return
        ours.finish(self._scanner.position)
        for token in self._scanner.end():
            self._note(token, self.attribution.owner(token), ours)

    def take_behind(self) -> int:
        """Attribute the frames behind the response, as on the idle line. Return the number of their bytes."""
        self._frames.clear()
        if self._behind:
            tokens, self._behind = self._behind, []
            self._attribute(tokens)
        ours = self._ledger.last
        return 0 if ours is None else self._scanner.position - ours.end_place

    def has_damaged_response(self, now: float) -> bool:
        """Tell whether the received bytes are the response, damaged, so that no other one comes."""
        return self.damaged_at is not None and now >= self.damaged_at

    def may_have_collided(self, unit: int, text: bytes) -> bool:
        """Tell whether a late response of another unit came during the request, or begins in `text`."""
        if any(owner == "a late response" and token.frame.unit != unit for token, owner in self._frames):
            return True
        return any(self._scanner.has_begun(text, head) for head in self._ledger.heads_of_others(unit))

    @property
    def _awaited(self) -> Exchange | None:
        """Our request on the line, whose response is awaited."""
        ours = self._ledger.last
        return ours if ours is not None and ours.is_awaited else None

    def _follow_ledger(self) -> None:
        """Update the scanner's late responses."""
        if self._ledger.late or self._scanner.late:
            self._scanner.late = self._ledger.owed()

    def _attribute(self, tokens: list[Token]) -> Outcome:
        """Find the owners of these frames, up to the one that ends the request."""
        for at, token in enumerate(tokens):
            awaited = self._awaited
            owner = self.attribution.owner(token)
            if owner != "the request":
                self._note(token, owner, awaited)
            if awaited is not None and not awaited.is_awaited:
                if len(tokens) > at + 1:
                    self._behind = tokens[at + 1 :]
                return self._finish(awaited, token)
        return None

    def _note(self, token: Token, owner: Owner, awaited: Exchange | None) -> None:
        """Record and report a frame that is not the response."""
        if owner == "a late response":
            self.late_responses.append((self.attribution.late, token.frame))
        elif awaited is not None and not (token.is_damaged or awaited.is_copy(token.frame)):
            self._telling.foreign(token.frame, awaited.sender)
        if owner != "an echo" or not self._echo.is_configured:  # else every request has one
            self._telling.record_heard(token, owner)
        if len(self._frames) < _FRAMES or awaited is None:
            self._frames.append((token, owner))

    def _finish(self, ours: Exchange, token: Token) -> Outcome:
        """End the request with its response, which is ambiguous if it may answer another client."""
        self._echo.record_response()
        doubt = self.attribution.doubt
        end = token.start if doubt is None else token.end
        if self._frames or end > ours.since:
            self._foresight.disturbed(token.at)
            if self._has_noise(ours.place, end):
                ours.sender.counts.noise += 1
                count = end - ours.place
                self._telling.record_noise(self._text[:count], count, ours.asked_at)
            self._notice_echo(ours)
        elif doubt is None and ours.since == ours.place:
            self._foresight.answered(ours, token, self._budget.line)
        behind = self._scanner.end()
        if behind:
            self._behind += behind
        if doubt is None:
            return token.frame
        self._telling.other_client(ours.sender, Frame(doubt.unit, doubt.asked.data))
        return AmbiguousResponse()

    def _has_noise(self, start: int, end: int) -> bool:
        """Tell whether bytes between these places belong to no frame."""
        at = start
        sound = [token for token, _ in self._frames if not token.is_damaged]
        for token in sorted(sound, key=lambda token: token.start):
            if at == token.start:
                at = token.end
        return at < end

    def _is_damaged(self, ours: Exchange) -> bool:
        """Tell whether all received bytes look like the response with a wrong checksum.

        It may be another response with a damaged unit identifier while a late response, another client's, or one to an
        earlier sending may come. Where copies or other clients were ever heard, it may also be a damaged request.
        """
        if self._ledger.late or self._ledger.heard or ours.owed > 1:
            return False
        begin = ours.since - ours.place
        if begin and not self._echo.is_configured:
            return False  # early bytes may have been another client's request
        shared = self.attribution.is_shared or self._echo.echoes
        if not self._scanner.is_damaged(self._text[begin:], ours, shared=shared):
            return False
        sound = [token for token, _ in self._frames if not token.is_damaged]
        if not all(ours.is_copy(token.frame) for token in sound):
            return False
        return begin == sum(token.end - token.start for token in sound)

    def _came_too_early(self, ours: Exchange, copies: list[Token], others: list[Token]) -> bool:
        """Tell whether the response came, but began before all of the request can have been sent.

        A copy of the request that could be its response counts as an echo, unless the port is known to have no wire.
        """
        if self._echo.is_configured:
            return False
        if self._echo.has_no_wire:
            others = others + copies
        return any(_is_early(token, ours) and ours.accepts(token.frame) for token in others)

    def _notice_echo(self, ours: Exchange) -> None:
        """Report an echo if a copy came before all of the request was sent."""
        if any(_is_early(token, ours) and ours.is_copy(token.frame) for token, _ in self._frames):
            self._echo.record_echo(ours.sender)

    def _patience(self, asked: RequestPdu, answer_time: AnswerTime) -> float:
        """Return how many seconds after another client's request its response may come: as many as after ours."""
        limit = self._budget.limit(asked, answer_time)
        return limit + self._ledger.length(limit, answer_time)


def _is_early(token: Token, ours: Exchange) -> bool:
    """Tell whether it began after the request did, but before all of that can have been sent."""
    return ours.place <= token.start < ours.since


def _is_response(frame: Frame) -> bool:
    """Tell whether only its unit can have sent `frame`: a request may look like a response."""
    if response_size(frame.pdu) not in {0, len(frame.pdu)}:
        return False
    try:
        return parse_sent(frame.pdu).function not in KNOWN_FUNCTIONS
    except RequestError:
        return True
