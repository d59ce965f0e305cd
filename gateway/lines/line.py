"""The state machine of one line: one request at a time, a silence before it, and a time limit for its response.

| state     | event                                   | next      | action                                            |
|-----------|-----------------------------------------|-----------|---------------------------------------------------|
| down      | `port_up`                               | idle      |                                                   |
| idle      | a request can be sent                   | awaiting  | it is written                                     |
| idle      | a broadcast can be sent                 | idle      | it is written; the turnaround silence begins      |
| awaiting  | the response                            | idle      | the client gets it                                |
| awaiting  | that to the read of a write to bits     | idle      | the write is sent next                            |
| awaiting  | the limit, an ambiguous response        | idle      | a late window opens; 0B, or at the limit a read   |
|           |                                         |           | waits for its repeat                              |
| awaiting  | the limit, to a read that may have to   | repeating |                                                   |
|           | wake its device; nothing came           |           |                                                   |
| awaiting  | a damaged response: no late window      | idle      | 0B                                                |
| awaiting  | a damaged one, or damaged bytes at the  | repeating |                                                   |
|           | limit, to a read that may be repeated   |           |                                                   |
| repeating | the line is quiet                       | awaiting  | the request is written again                      |
| repeating | bytes come: they may be the response    | idle      | 0B                                                |
| idle      | the connection ends in order, `renew`:  | closed    | what waits has it opened again                    |
|           | it may hold requests back, or nobody    |           |                                                   |
|           | has asked for `idle` seconds            |           |                                                   |
| closed    | a request                               | closed    | it has the connection opened, and waits           |
| closed    | `port_up`                               | idle      |                                                   |
| closed    | a request has waited too long for that  | closed    | 0A                                                |
| any other | `port_down`                             | down      | 0B for what was sent, 0A for all waiting requests |
| awaiting  | `finish`                                | last      | 0A for all waiting requests                       |
| any other | `finish`                                | down      | the same, and 0B for what was to be repeated      |
| last      | the response, the limit                 | down      | as from awaiting                                  |

`scheduler` chooses the next request, `receiver` finds the response in the bytes from the line.

There is no I/O here: bytes, time and requests are arguments, and `deadline` is when to call `tick`. A line finishes its
own state before it answers requests, because an answer may cause the next request at once.
"""

from collections.abc import Callable
from dataclasses import replace
from math import inf, nextafter
from typing import Final, Literal

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.echo import EchoDetector
from gateway.lines.exchange import Exchange
from gateway.lines.ledger import HasArrived, Ledger
from gateway.lines.receiver import NOTHING, Outcome, Receiver
from gateway.lines.scheduler import MaySend, Scheduler, earliest
from gateway.lines.settings import LineSettings
from gateway.lines.telling import Telling
from gateway.lines.transaction import TakesTransactions, Transaction
from gateway.modbus.frame import Frame
from gateway.ports.port import OpenAgain
from gateway.timing.budget import Budget
from gateway.timing.measured import Phases, TimeSpent
from gateway.trace.ring import Ring

#: The silence after a device has confirmed a new baud rate, in seconds: time for the device and our port to change.
RATE_CHANGE_PAUSE: Final = 0.1

#: Sends bytes.
Write = Callable[[bytes], None]
#: Called with each transaction that was on the line, its response or None, and the time.
Observer = Callable[[Transaction, Frame | None, float], None]
#: See the table above.
State = Literal["down", "idle", "awaiting", "repeating", "closed", "last"]


class Line(TakesTransactions):
    """One line and its transactions, which are recorded in `ring`."""

    def __init__(self, settings: LineSettings, emit: Emit, ring: Ring | None = None) -> None:
        self.settings = settings
        #: Number of bytes on the idle line; the use of the line's time; the observer of transactions.
        self.unasked_bytes = 0
        self.spent = TimeSpent()
        self.observer: Observer | None = None
        self._telling = Telling(settings.name, settings.source, emit, settings.timing.mode, ring)
        #: All exchanges whose responses may still come.
        self.ledger = Ledger(settings.late_window)
        echo = EchoDetector(self._telling, is_configured=settings.echo)
        self._receiver = Receiver(settings, self.ledger, echo, self._telling)
        self._scheduler = Scheduler(settings, self.ledger, echo, self._telling, self._limit_of)
        #: Other clients on the line, and the requests that wait.
        self.attribution = self._receiver.attribution
        self.queue = self._scheduler.queue
        self._write: Write | None = None
        self._is_virtual = True
        self._state: State = "down"
        #: What was received in place of a response to the last sending.
        self._diagnosis = NOTHING
        self._quiet_at = 0.0
        #: When the port was opened, or the last request was over.
        self._used_at = 0.0
        self._tune(latency=0.0)

    def phases(self, now: float) -> Phases:
        """Return the use of the line's time, including the transaction in progress."""
        current = self.ledger.current
        if current is None or not self._is_awaiting:
            return self.spent.phases()
        asked_at = min(current.asked_at, now)
        return self.spent.phases(asked_at - current.sender.sent_at, now - asked_at)

    def share(self, may_send: MaySend, heard_other: Callable[[], None]) -> None:
        """Share the line with other gateways: send only while `may_send()`; call `heard_other` when a client asks."""
        self._scheduler.may_send = may_send
        self.attribution.heard_other = heard_other

    def be_silent(self, until: float) -> None:
        """Send nothing before the time `until`."""
        self._quiet_at = max(self._quiet_at, until)

    def port_up(
        self, write: Write, latency: float, now: float, *, virtual: bool = True, has_arrived: HasArrived | None = None
    ) -> None:
        """Start sending: the port is open, and requests are sent with `write`.

        The port may add `latency` seconds to a response. A `virtual` port carries bytes at once, so a response can come
        before a real line could have carried the request. `has_arrived` is None unless it is a connection.
        """
        self._is_virtual = virtual
        self._tune(latency)
        self._write = write
        self._used_at = now
        self._quiet_at = now + self._gap
        self.ledger.connected(has_arrived)
        if self._state != "closed":
            self._scheduler.end_rests()
        self._scheduler.reopening.end(now)
        self._state = "idle"

    def port_down(self, now: float) -> None:
        """Fail all requests: the sent one with 0B, because the unit may have acted on it, others with 0A."""
        self._disconnect("down", now)
        waiting = self._scheduler.clear()
        try:
            if self.ledger.current is not None:
                self._finish(self.ledger.current, errors.LineLost(), now)
        finally:
            self._scheduler.fail_unsent(waiting, now)

    def must_renew(self, now: float) -> bool:
        """Tell whether a new connection is needed: this one may hold back requests."""
        return not self.is_busy and self.ledger.must_renew(now)

    def may_leave(self, now: float) -> bool:
        """Tell whether the connection may be closed until the next request, because nobody has asked for so long."""
        leaves_at = self._leaves_at()
        if leaves_at is None or now < leaves_at:
            return False
        if self.ledger.is_underway():  # a broadcast
            self._used_at = now
            return False
        return True

    def renew(self, now: float) -> None:
        """Keep waiting requests for a new connection, because this one is being closed."""
        self._disconnect("closed", now)
        self._scheduler.reopening.begin(now)

    def port_ended(self, open_again: OpenAgain, now: float, *, at_once: bool = False) -> None:
        """Note that a connection has ended in order; `at_once` after it was opened, or later. If idle, that is no loss.

        It is opened again for waiting requests, or for the next one; if another client may be there, at once, to hear
        it, and so without `idle` after `renew`. But a connection that ends at once while requests wait is a loss: they
        would wait in vain.
        """
        is_empty, is_kept = self._scheduler.is_empty, False
        if self._state == "closed":  # by `renew`
            is_kept = not self.settings.idle
        elif self._state == "idle" and (is_empty or not at_once):
            self.renew(now)
        else:
            return
        is_needed = is_kept or not (is_empty and (at_once or self.attribution.is_alone(now)))
        self._scheduler.reopening.ended(open_again, is_needed=is_needed)

    @property
    def is_closed(self) -> bool:
        """Whether the line has no connection because none is needed."""
        return self._state == "closed"

    @property
    def is_busy(self) -> bool:
        """Whether a request is on the line, or about to be sent again."""
        return self.ledger.current is not None

    def can_send(self, now: float) -> bool:
        """Tell whether a request would be sent at once."""
        return self._state != "awaiting" and now >= self._free_at()

    def finish(self, now: float) -> None:
        """Accept no more requests: waiting ones fail with 0A, the one on the line may still be answered."""
        is_repeating = self._state == "repeating"
        self._disconnect("last" if self.is_busy else "down", now)
        self._scheduler.refusals.tell(inf)
        waiting = self._scheduler.clear()
        try:
            if is_repeating and self.ledger.current is not None:
                self._fail(self.ledger.current, now)
        finally:
            self._scheduler.fail_unsent(waiting, now)

    def change_rate(self, baud: int, now: float) -> None:
        """Use another rate after the transaction on the line. Nothing is sent while devices and port change."""
        self.settings = replace(self.settings, timing=replace(self.settings.timing, baud=baud))
        if not self.is_busy:
            self._follow_rate(now)

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent in its turn, that of a scan when nothing else waits, or fails."""
        is_down = self._write is None and self._state != "closed"
        rejection = errors.LineDown() if is_down else self._scheduler.put(transaction, now)
        if rejection is not None:
            self._scheduler.refuse(transaction, rejection, now)
        elif self._write is None:
            self._scheduler.reopening.need(transaction)
        elif not self.is_busy:
            self._go_on(now)

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Take bytes. A frame that contains all of the `damaged` ones is no response."""
        if self._state == "repeating" and self.ledger.current is not None:
            self._stop_repeating(self.ledger.current, now)
        current = self.ledger.current
        if current is None:
            self._quiet_at = max(self._quiet_at, now + self._gap)
            self._receiver.received(data, now, damaged=damaged)
            self._take_idle(len(data), now)
            return
        early = not self._is_virtual and now < current.asked_at and not self.settings.echo
        if not early:
            self._quiet_at = now + self._gap
            early = self.ledger.is_underway()
        outcome = self._receiver.received(data, now, damaged=damaged, early=early)
        self._report_late(now)
        if outcome is not None:
            self._take(current, outcome, now)

    def deadline(self) -> float | None:
        """Return when to call `tick`; None if there is no need to."""
        current = self.ledger.current
        if current is not None:
            deadline = earliest(self._next_step(current), self.queue.next_expiry())
        elif self._write is None:
            deadline = earliest(self._scheduler.reopening.until, self.queue.next_expiry())
        else:
            deadline = self._scheduler.deadline(self._free_at())
            if self._receiver.silent_at < inf:
                deadline = earliest(deadline, self._receiver.silent_at)
            if self.settings.idle:
                deadline = earliest(deadline, self._leaves_at())
        if self._scheduler.refusals.tells_at < inf:
            deadline = earliest(deadline, self._scheduler.refusals.tells_at)
        return earliest(deadline, self._receiver.late_deadline()) if self.ledger.late else deadline

    def read_at(self, now: float) -> float | None:
        """Return when to read the port again: no earlier byte decides anything. None: at the next byte."""
        if self.ledger.late:
            return None
        return self._quiet_at if self._is_silent(now) else self._receiver.read_at(now)

    def tick(self, now: float) -> None:
        """Let time pass: a silence, a time limit or a late window may have ended."""
        outcome = self._receiver.tick(now)
        self._report_late(now)
        if now >= self._receiver.silent_at:  # a frame of unknown size, of a unit that rests, is complete
            self._scheduler.record_frames(self._receiver.ended_by_silence(self._scheduler.resting))
        if self.ledger.late:
            self.ledger.await_arrived(self._receiver.position, now)
        if now >= self._scheduler.refusals.tells_at:
            self._scheduler.refusals.tell(now)
        if self._scheduler.reopening.until is not None:
            self._scheduler.fail_unsent(self._scheduler.reopening.given_up(now), now)
        current = self.ledger.current
        if current is not None and outcome is not None:
            self._take(current, outcome, now)
        elif current is not None and self._is_awaiting and now >= self._next_step(current):
            self._give_up(current, now)
        self._go_on(now)

    def _is_silent(self, now: float) -> bool:
        """Tell whether a request waits only for the silence after a response: the port is read before it is sent."""
        is_gap = self._state == "idle" and 0.0 < self._quiet_at - now <= self._gap
        return is_gap and len(self.queue) > 0 and self._receiver.is_undisturbed(now)

    @property
    def _is_awaiting(self) -> bool:
        return self._state in ("awaiting", "last")

    def _free_at(self) -> float:
        """Return when a request may be sent: the line was silent long enough, and no other exchange occupies it."""
        return max(self._quiet_at, self.ledger.occupied_until()) if self.ledger.heard else self._quiet_at

    def _leaves_at(self) -> float | None:
        """Return when the connection may be closed until the next request; None if it may not."""
        if not self.settings.idle or self._state != "idle" or not self._scheduler.is_empty:
            return None
        return max(self._used_at + self.settings.idle, self.ledger.all_over_at())

    def _tune(self, latency: float) -> None:
        """Set the times that follow from the line's timing and its port's latency."""
        self._budget = Budget(self.settings.timing, latency)
        self._gap = self.settings.silence_before_request
        self.spent.tune(self.settings.timing)
        self._receiver.tune(self._budget, self.settings.frame_end + latency, virtual=self._is_virtual)

    def _disconnect(self, state: State, now: float) -> None:
        self._state = state
        self._write = None
        self.ledger.connected(None)
        self._scheduler.reopening.end(now)

    def _limit_of(self, transaction: Transaction) -> float:
        """Return the time limit of a transaction that has not been sent."""
        return self._budget.limit(transaction.asked, transaction.device.answer_time)

    def _follow_rate(self, now: float) -> None:
        self._tune(self._budget.latency)
        self._quiet_at = max(self._quiet_at, now + RATE_CHANGE_PAUSE)

    def _next_step(self, current: Exchange) -> float:
        """Return when the state ends without an event. A begun response of unknown size may still be completed."""
        if self._state == "repeating":
            return self._free_at()
        silence, fails_at = self._receiver.deadline(), current.sender.fails_at
        if silence is not None:
            return silence if silence <= fails_at else min(silence, fails_at + self.settings.timing.longest_frame)
        damaged_at = self._receiver.damaged_at
        return fails_at if damaged_at is None else min(damaged_at, fails_at)

    def _go_on(self, now: float) -> None:
        """Send the next request if the line is free and quiet, and fail those that have waited too long."""
        late = self.queue.expired(now)
        not_repeated = self.queue.expired_repeats(now)
        try:
            while self._write is not None and self._state != "awaiting" and now >= self._free_at():
                again = self.ledger.current
                transaction = self._scheduler.next(now) if again is None else again.transaction
                if transaction is None:
                    break
                rejection = None
                if again is None:
                    is_wanted = transaction.is_wanted
                    rejection = self._scheduler.rejection(transaction, now) if is_wanted else transaction.unwanted
                if rejection is None:
                    self._send(transaction, self._write, now)
                else:
                    self._scheduler.refuse(transaction, rejection, now)
        finally:
            if late:
                self._scheduler.fail_expired(late, now)
            for transaction in not_repeated:
                self._scheduler.refuse(transaction, errors.ResponseTimeout(), now)

    def _send(self, transaction: Transaction, write: Write, now: float) -> None:
        may_send = self._scheduler.may_send
        if may_send is not None and not may_send():  # repeats were sent before
            current = self.ledger.current
            if current is None:
                self._scheduler.fail_unsent([transaction], now)
            else:
                self._finish(current, errors.LineLost(), now)
            return
        if self._receiver.silent_at < inf:
            self._scheduler.record_frames(self._receiver.ended_by_silence(self._scheduler.resting))
        self._state = "awaiting"
        transaction = transaction.opening()
        current = self.ledger.take(transaction)
        try:
            transaction.start(self._budget, now)
        except RequestError as error:
            self.ledger.current, self._state = None, "idle"
            self._scheduler.refuse(transaction, error, now)
            return
        transaction.count_sent(now)
        self._scheduler.sent()
        if transaction.expects_answer:
            self._quiet_at = transaction.ends_at + self._gap
            write(self._receiver.begin(current, now))
        else:
            self._send_unanswered(current, write, now)

    def _send_unanswered(self, current: Exchange, write: Write, now: float) -> None:
        """Send a request without a response, and give the devices time to act."""
        transaction = current.sender
        self._state = "idle"
        self._quiet_at = transaction.ends_at + max(self.settings.turnaround, self._gap)
        self._spend(transaction, 0, transaction.ends_at)
        forbidden = self._scheduler.end(now)  # a unit without a listen-only mode responds all the same
        try:
            write(self._receiver.begin(current, now))
            self._telling.record_sent(transaction, None, now)
        finally:
            transaction.end()
            self._scheduler.fail_forbidden(forbidden, now)

    def _take_idle(self, size: int, now: float) -> None:
        self.unasked_bytes += size
        self._report_late(now)
        if size and self._scheduler.resting:
            self._scheduler.record_frames(self._receiver.responding(now))
        self._go_on(now)

    def _report_late(self, now: float) -> None:
        """Report the late responses that came."""
        if not self._receiver.late_responses:
            return
        late, self._receiver.late_responses = self._receiver.late_responses, []
        for exchange, frame in late:
            transaction = exchange.transaction
            if transaction is not None:
                is_expected = transaction.is_scan or (transaction.device.sleep.wake and exchange.is_answered)
                if not is_expected:
                    self._telling.late_response(transaction, now)
                self._scheduler.record_response(exchange)
                transaction.device.finished(transaction, frame)

    def _take(self, current: Exchange, outcome: Outcome, now: float) -> None:
        """End the transaction with the response, or as ambiguous."""
        if isinstance(outcome, Frame):
            current.sender.count_response(now)
            current.owed -= 1
            self._scheduler.record_response(current)
        else:  # the response to this request may come next
            self._quiet_at = max(self._quiet_at, current.sender.fails_at)
        self._finish(current, outcome, now)

    def _give_up(self, current: Exchange, now: float) -> None:
        """Send the request again if allowed, else fail it: no response came.

        A damaged response is repeated at once, and so is a read of a device that may have slept. After other silence,
        or if the response may be another client's, the late window comes first.
        """
        transaction = current.sender
        diagnosis = self._diagnosis = self._receiver.diagnose()
        self._report_late(now)
        current.owed -= self._receiver.has_damaged_response(now)
        is_ours = not self.attribution.may_be_others(current)
        if transaction.wakes and diagnosis.verdict == "nothing" and is_ours and self._is_wanted(transaction):
            self.ledger.note_silence(current)
            self._repeat(transaction, now)
            return
        if current.owed:  # nothing is owed after a damaged response
            self._record_silence(current, diagnosis.text, now)
        at_once = diagnosis.verdict == "broken" and is_ours
        if not self._may_repeat(transaction, now if at_once else self.ledger.end_of(transaction, now)):
            self._fail(current, now)
        elif at_once:
            self._repeat(transaction, now)
            transaction.retries += 1
        else:
            self._finish(current, None, now)

    def _repeat(self, current: Transaction, now: float) -> None:
        """Have the request sent again as soon as the line is free; nothing else is sent before that."""
        self._telling.record_failed(current, None, now, self._diagnosis.text)
        self._spend(current, 0, now)
        self._state = "repeating"

    def _record_silence(self, current: Exchange, text: bytes, now: float) -> None:
        """Note a failure of the unit, unless a late response of another unit may have collided with its response."""
        if not text:
            self.ledger.note_silence(current)
        if not (current.sender.is_scan or self._receiver.may_have_collided(current.unit, text)):
            self._scheduler.record_failure(current.sender, now)

    def _is_wanted(self, current: Transaction) -> bool:
        """Tell whether the line may send this request again, and a client wants that."""
        return self._write is not None and current.is_wanted

    def _may_repeat(self, current: Transaction, at: float) -> bool:
        """Tell whether the request may be sent again, not before the time `at`."""
        if current.retries >= self.settings.retries or not current.asked.only_reads or current.is_scan:
            return False
        if not self._is_wanted(current):
            return False
        if not current.retries:
            window = self.ledger.end_of(current, current.fails_at) - current.fails_at
            request = current.ends_at - current.sent_at
            within = self.settings.time_for_repeats(request, current.limit, window)
            current.gives_up_at = current.sent_at + within - request - current.limit
        return at <= current.gives_up_at

    def _stop_repeating(self, current: Exchange, now: float) -> None:
        """Fail a request that was to be sent again: bytes came that may be its response. Nothing else is sent now."""
        current.owed = max(1, current.owed)
        self._quiet_at = max(self._quiet_at, nextafter(now, inf))
        self._fail(current, now)

    def _fail(self, current: Exchange, now: float) -> None:
        """Fail the transaction, and report the reason."""
        verdict, text = self._diagnosis
        transaction = current.sender
        if not transaction.is_scan:
            is_echo, is_damaged = verdict == "echo", not current.owed
            self._telling.given_up(transaction, now, received=text, is_echo=is_echo, is_damaged=is_damaged)
        elif verdict != "broken":
            text = b""  # only frames of others: the unit itself is silent
        self._finish(current, errors.BrokenResponse() if text else errors.ResponseTimeout(), now)

    def _finish(self, current: Exchange, outcome: Frame | RequestError | None, now: float) -> None:
        """End the transaction; without an outcome it waits to be sent again."""
        transaction = current.sender
        self._receiver.stop()
        if isinstance(outcome, Frame):
            self._telling.record_sent(transaction, outcome.pdu, now, outcome.unit)
        else:
            is_told = not isinstance(outcome, errors.AmbiguousResponse | errors.LineLost)
            late_until = self.ledger.end_of(transaction, now) if current.owed else 0.0
            heard = self._diagnosis.text if is_told else b""
            self._telling.record_failed(transaction, outcome, now, heard, late_until)
        forbidden = self._scheduler.end(now)
        response = outcome if isinstance(outcome, Frame) else None
        following = transaction.following(response.pdu) if response is not None else None
        if outcome is None:
            self.queue.put_back(transaction.again())
        elif following is not None and self._write is not None:
            following.gives_up_at = now + transaction.limit
            self.queue.put_back(following)
            following = None
        if self._state != "repeating":
            self._spend(transaction, 0 if response is None else len(response.pdu), now)
        self._state = "down" if self._write is None else "idle"
        if self._budget.line is not self.settings.timing:
            self._follow_rate(now)
        try:
            transaction.device.finished(transaction, response)
            if self.observer is not None:
                self.observer(transaction, response, now)
            self._take_idle(self._receiver.take_behind(), now)
        finally:
            if response is not None:
                transaction.respond(response.pdu, now)
            elif isinstance(outcome, RequestError):
                transaction.fail_sent(outcome, now)
            if following is not None:
                self._scheduler.fail_unsent([following], now)
            self._scheduler.fail_forbidden(forbidden, now)

    def _spend(self, transaction: Transaction, response: int, now: float) -> None:
        """Count the line's time until `now` for the client of the first request; `response` is a PDU's size."""
        self._used_at = now
        self.spent.add(transaction.sent_at, transaction.ends_at, now, response, self._quiet_at)
        caller, until = transaction.requests[0].caller, max(now, self._quiet_at)
        client, function = caller.host or caller.client, transaction.asked.function
        self.spent.usage.add(client, transaction.unit, function, until - transaction.sent_at)

    def __repr__(self) -> str:
        current = "" if self.ledger.current is None else f" {self.ledger.current.sender!r}"
        return f"<Line {self.settings.name} {self._state}{current} waiting={len(self.queue)}>"
