"""What comes from a line, and what it means: the answer to the one request on it, echoes, other clients, noise.

The framer finds what looks like the answer, and the ear knows whether another client may have asked for it. When
nothing but the answer was heard, as nearly always, nobody looks further.
"""

from collections.abc import Iterator
from typing import Final

from gateway.errors import AmbiguousResponse
from gateway.lines.ear import ECHOES, Ear, Stranger
from gateway.lines.echo import Echo
from gateway.lines.late import LateWindows
from gateway.lines.look import HELD_BACK, is_paced, look_at, look_at_noise
from gateway.lines.overheard import Overheard, Verdict, before, is_damaged, is_response, overheard
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.transaction import Transaction
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import MAX_ASCII_ADU, MAX_RTU_ADU
from gateway.modbus.frame import Frame, ResponseFramer
from gateway.modbus.pdu import RequestPdu
from gateway.modbus.rtu import ResponseFramer as RtuFramer
from gateway.modbus.rtu import ended_by_silence
from gateway.timing.budget import Budget

#: So much is kept to tell what was heard before an answer or instead of one.
_SIZE: Final = 1024
#: Bytes on an idle line belong together if no more seconds part them: longer than a hole inside an ASCII frame.
_FRESH: Final = 1.0
#: After so many answers in a row that came too early, the port is known to have no wire.
EARLY_ANSWERS: Final = 3

#: What has come of a request: its answer, or one that may be another's; None as long as nothing has.
Outcome = Frame | AmbiguousResponse | None


class Hearing:
    """Listens to one line. Between `begin` and the next one there is one request whose answer is sought.

    Every byte goes through `hear` first. `late` are answers to older requests that have come since `begin`: they have
    their own receivers. `echo_suspected` says that the adapter was caught returning what is sent. `deadline` is when
    silence ends a response of unknown size. `damaged_at` is when silence will have shown that what came is the answer
    with a wrong check sum, None unless it looks so. `listen` is the ear's.
    """

    def __init__(self, settings: LineSettings, windows: LateWindows, report: Report) -> None:
        self.late: list[Frame] = []
        self.echo_suspected = False
        self.damaged_at: float | None = None
        self._windows = windows
        self._mode = settings.timing.mode
        self._late_window = settings.late_window
        self._report = report
        self._ear = Ear(self._mode, windows, self._patience)
        self.hear = self._ear.hear
        self.listen = self._ear.listen
        self._echo = Echo() if settings.echo else None
        self._budget = Budget(settings.timing, 0.0)
        self._silence = 0.0
        self._is_virtual = True
        self._listen_anew()
        self._current: Transaction
        self._sent = b""
        #: What came before all of the request can have left, so that it can be no answer; and what came since.
        self._early = bytearray()
        self._heard = bytearray()
        #: When the first of that was read, and how much came with it.
        self._first_at = 0.0
        self._came_first = 0
        #: Whether other frames came since that are no answer, and what came instead of one.
        self._foreign = False
        self._instead: Overheard
        #: Whether the answer has come too early, and of how many requests in a row without one that came in time.
        self._is_early = False
        self._early_answers = 0
        self._idle = bytearray()
        self._idle_at = 0.0
        #: How much has come since the last silence.
        self._unparted = 0

    def tune(self, budget: Budget, silence: float, *, virtual: bool) -> None:
        """So many seconds of silence end a frame of unknown size. A `virtual` port carries bytes at once."""
        self._budget = budget
        self._silence = silence
        self._is_virtual = virtual
        self._listen_anew()

    def begin(self, transaction: Transaction, now: float, deaf_until: float) -> bytes:
        """The request goes on the line, and nothing is its answer before `deaf_until`. Its frame."""
        self._current = transaction
        echo_until = 0.0 if self._is_virtual else transaction.ends_at + self._silence
        self._ear.begin(transaction, now, deaf_until, echo_until, echoes=self._echo is not None or self.echo_suspected)
        if self._ear.echoes_in_a_row >= ECHOES and not self.echo_suspected:
            self._tell_echo()  # one copy may be another client's; one of every request is an echo that comes late
        if transaction.expects_answer:
            self._forget()
            self._framer.expect(transaction.answers_from, transaction.asked)
        self._sent = self._framer.encode(transaction.unit, transaction.asked.data)
        self._unparted = 0
        if self._echo is not None:
            self._echo.expect(self._sent)
        return self._sent

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> Outcome:
        """Take bytes that may belong to the answer."""
        if self._echo is not None:
            rest = self._echo.strip(data)
            damaged = damaged and rest == data  # else it may be the echo that was damaged
            data = rest
            self._early[:] = self._echo.before
        if not self._heard:
            self._first_at = now
            self._came_first = len(data)
        if len(self._heard) < _SIZE:
            self._heard += data
        outcome = self._judge(self._framer.received(data, now, damaged=damaged))
        self.damaged_at = now + self._silence if outcome is None and self._is_damaged() else None
        return outcome

    def deafen(self, now: float) -> float:
        """What has come up to `now` is no answer: the request has not arrived. From when on there can be one."""
        return self._ear.deafen(now)

    def received_early(self, data: bytes) -> None:
        """Take bytes that came before all of the request can have left."""
        if len(self._early) < _SIZE:
            self._early += data

    def received_idle(self, data: bytes, now: float) -> None:
        """Take bytes that came while nothing was asked."""
        self._ear.listen()
        if now - self._idle_at > _FRESH:
            self._idle.clear()
        if now - self._idle_at - len(data) * self._budget.line.character > self._silence:
            self._unparted = 0
        self._idle += data
        del self._idle[:-_SIZE]
        self._idle_at = now
        self._unparted += len(data)

    def look_at(self, now: float) -> float | None:
        """When to look at the line again, because nothing that comes before can complete the answer; None: always.

        What came faster than the line can carry it tells nothing of when the rest comes. That counts from the first
        byte, however long the device has thought before.
        """
        missing = self._framer.missing
        character = self._budget.line.character
        came = len(self._heard) - self._came_first
        if not missing or not is_paced(came, character, now - self._first_at):
            return None
        return look_at(missing, character, now, 0.0 if self._is_virtual else HELD_BACK, proven=came > 0)

    def look_at_idle(self, now: float) -> float | None:
        """The same while nothing is asked."""
        return look_at_noise(self._budget.line.character, now) if self._is_noisy else None

    def have_spoken(self, units: set[int]) -> set[int]:
        """Those of `units` that have sent a frame, while nothing was asked, which the bytes that came last complete.

        In lasting noise no frame of unknown size is looked for.
        """
        frames = [frame for frame in self._ear.passed if len(self._framer.encode(*frame)) <= len(self._idle)]
        if self._mode == "rtu" and not self._is_noisy:
            frames += ended_by_silence(bytes(self._idle[-MAX_RTU_ADU:]), units)
        return {frame.unit for frame in frames if frame.unit in units and is_response(frame)}

    def tick(self, now: float) -> Outcome:
        """Let time pass."""
        return self._judge(self._framer.tick(now))

    def conclude(self) -> None:
        """The answer has not come in time; `verdict` and `instead` say what has come."""
        self._stop_asking()
        for frame in self._framer.conclude():
            self._is_foreign(frame)
        late = [self._framer.encode(*frame) for frame in self.late]
        self._instead = overheard(self._mode, self._all_heard(), self._sent, late)
        self._is_early = self._came_too_early(self._instead)
        if self._is_early:
            self._early_answers += not self._is_virtual  # a connection may be slow, and says nothing about a wire
            self._report.too_early(self._current, proven=self._early_answers == EARLY_ANSWERS)
        self._notice_echo(self._instead.echo_at)

    @property
    def verdict(self) -> Verdict:
        """What was heard instead of an answer, in one word."""
        return self._instead.verdict

    def instead(self) -> bytes:
        """What was heard instead of an answer; nothing if it is late answers to older requests, or came too early."""
        return b"" if self._is_early or self.verdict is Verdict.NOTHING else self._all_heard()

    def may_be_others(self) -> bool:
        """Whether another client waits for an answer of the unit that was asked."""
        return self._ear.may_doubt(self._current)

    def has_answered(self, now: float) -> bool:
        """Whether what was heard is the answer, damaged: then it is not owed any more."""
        return self.damaged_at is not None and now >= self.damaged_at

    def window_end(self, transaction: Transaction, now: float) -> float:
        """Until when a late answer is awaited: by default for twice the limit, or the device's slowest answer.

        That begins with the end of the limit, also for a transaction that has failed before.
        """
        length = self._late_window
        if length is None:
            length = max(2 * transaction.limit, transaction.device.answer_time.slowest)
        return max(now, transaction.fails_at) + length

    def hand_over(self) -> ResponseFramer:
        """The framer that looks for the answer, for those who go on looking."""
        self._stop_asking()
        framer = self._framer
        self._listen_anew()
        return framer

    def unanswered(self) -> Iterator[Stranger]:
        """What other clients have asked and nobody has answered yet."""
        self._ear.listen()
        return (stranger for strangers in self._ear.strangers.values() for stranger in strangers)

    def framer_for(self, unit: int | None, asked: RequestPdu) -> ResponseFramer:
        """One that looks for an answer to `asked` from `unit`, None from any."""
        framer = self._new_framer()
        framer.expect(unit, asked)
        return framer

    @property
    def _is_noisy(self) -> bool:
        """Whether more has come without a silence than any frame has."""
        return self._unparted > (MAX_ASCII_ADU if self._mode == "ascii" else MAX_RTU_ADU)

    def _stop_asking(self) -> None:
        self._ear.listen()
        self._ear.end()

    def _listen_anew(self) -> None:
        self._framer = self._new_framer()
        self.deadline = self._framer.deadline

    def _new_framer(self) -> ResponseFramer:
        return AsciiFramer() if self._mode == "ascii" else RtuFramer(self._silence)

    def _forget(self) -> None:
        self._idle.clear()
        self.late.clear()
        self._early.clear()
        self._heard.clear()
        self._foreign = False
        self.damaged_at = None

    def _is_damaged(self) -> bool:
        """Whether all that has come is, for what can be seen, the answer with a wrong check sum.

        While another answer is late, or another client awaits one, it may be that, with a damaged unit identifier.
        While one to an earlier sending is, it may be that one.
        """
        current = self._current
        if self._early or self._foreign or self._windows.windows or current.owed > 1:
            return False
        if not is_damaged(self._mode, self._heard, current.asked, current.answers_from):
            return False
        self._ear.listen()
        return not (self._ear.strangers or self._ear.doubts)

    def _patience(self, asked: RequestPdu) -> float:
        """How long after another client has asked this its answer may come, if we ask the same device: as to us."""
        answer_time = self._current.device.answer_time
        limit = self._budget.limit(asked, answer_time)
        return limit + (max(2 * limit, answer_time.slowest) if self._late_window is None else self._late_window)

    def _judge(self, frames: list[Frame]) -> Outcome:
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
        self._early_answers = 0
        is_alone = self._framer.is_clean and not (self._foreign or self._early or self.late)
        if is_alone and not self._ear.may_doubt(self._current):
            self._ear.skip()
            return answer
        return self._listen_back(answer)

    def _listen_back(self, answer: Frame) -> Outcome:
        """Find out what was heard beside `answer`; it is ambiguous when another client has asked the same unit."""
        current = self._current
        self._stop_asking()
        self._ear.answered(answer)
        data = before(self._mode, self._all_heard(), self._framer.encode(*answer))
        heard = overheard(self._mode, data, self._sent)
        self._notice_echo(heard.echo_at)
        current.counts.noise += heard.verdict is Verdict.BROKEN
        if self._mode == "rtu":  # in ASCII the framer has handed them over
            for frame in heard.frames:
                if not current.accepts(frame):
                    self._is_foreign(frame)
        if not self._ear.doubts:
            return answer
        self._report.other_client(current, self._ear.doubts[0].frame)
        return AmbiguousResponse()

    def _all_heard(self) -> bytes:
        return bytes(self._early + self._heard)

    def _is_foreign(self, frame: Frame) -> bool:
        """Tell of a frame that is no answer, unless it is a late one to an older request."""
        if frame in self.late:
            return False
        self._report.foreign(frame, self._current)
        return True

    def _came_too_early(self, heard: Overheard) -> bool:
        """Whether the answer is in what was heard, though it began before all of the request can have left.

        A copy of the request that can be its answer is taken for an echo, until the port is known to have no wire.
        """
        if not self._early or self._echo is not None:
            return False
        asked = self._current.asked
        if self._has_no_wire and 0 <= heard.echo_at < len(self._early) and asked.accepts(asked.data):
            return True
        return any(map(self._current.accepts, heard.frames))

    @property
    def _has_no_wire(self) -> bool:
        return self._early_answers >= EARLY_ANSWERS

    def _notice_echo(self, echo_at: int) -> None:
        """A copy of what was sent began at `echo_at`, if not -1. Before all of it has left, no one else can copy it."""
        if 0 <= echo_at < len(self._early):
            self._tell_echo()

    def _tell_echo(self) -> None:
        if not (self._is_virtual or self._has_no_wire) and self._echo is None:
            self._report.echo(self._current, first=not self.echo_suspected)
            self.echo_suspected = True
