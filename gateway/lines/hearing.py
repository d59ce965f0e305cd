"""All that is heard on a line from a request on: kept until its answer is there, to tell what else was on the line."""

from collections.abc import Iterable
from typing import Final

from gateway.lines.overheard import Overheard, has_begun, is_from, overheard, requests_in
from gateway.lines.transaction import Transaction
from gateway.modbus.chartime import Mode
from gateway.modbus.frame import Frame, ResponseFramer

#: So much is kept of what was heard.
_SIZE: Final = 1024
#: Bytes on an idle line belong together if no more seconds part them: longer than a hole inside an ASCII frame.
_FRESH: Final = 1.0


class Hearing:
    """What was heard since one request was sent.

    `sent` is the request's frame. `early` came before all of it can have left, so that it can be no answer. `late` are
    answers to older requests, which have their own receiver. `foreign` says that other frames came that are no answer.
    `strangers` are other clients' requests from shortly before: they may be answered now.
    """

    def __init__(self) -> None:
        self.sent = b""
        self._asked = b""
        self.early = bytearray()
        self.late: list[Frame] = []
        self.foreign = False
        self.strangers: tuple[Frame, ...] = ()
        self._heard = bytearray()
        self._idle = bytearray()
        self._idle_at = 0.0
        self._strangers: list[tuple[float, Frame]] = []

    def said(self, sent: bytes, asked: bytes) -> None:
        """The request with the PDU `asked` goes out as `sent`. A copy of it later on is an answer, not a stranger's."""
        self.sent, self._asked = sent, asked

    def keep_idle(self, data: bytes, now: float) -> None:
        """These bytes came while nothing was asked."""
        if now - self._idle_at > _FRESH:
            self._idle.clear()
        self._idle += data
        del self._idle[:-_SIZE]
        self._idle_at = now

    def is_idle_from(self, unit: int, mode: Mode) -> bool:
        """Whether a frame from `unit` has come while nothing was asked."""
        return is_from(unit, mode, bytes(self._idle))

    def lost(self, heard: bytes, mode: Mode, now: float) -> None:
        """The request was not answered; this was heard instead."""
        self.keep_strangers(requests_in(mode, heard.replace(self.sent, b"")), now)

    def keep_strangers(self, requests: Iterable[Frame], now: float) -> None:
        """Other clients have asked this, and may not have their answers yet."""
        self._strangers += [(now, frame) for frame in requests]

    def begin(self, mode: Mode, now: float, limit: float) -> None:
        """A request goes on the line that is answered within `limit`, as those of others are: forget what is older."""
        if self._idle:
            requests = requests_in(mode, bytes(self._idle))
            self.keep_strangers((frame for frame in requests if frame.pdu != self._asked), self._idle_at)
            self._idle.clear()
        if self._strangers or self.strangers:
            self._strangers = [(at, frame) for at, frame in self._strangers if now - at <= limit]
            self.strangers = tuple(frame for _, frame in self._strangers)
        self.early.clear()
        self.late.clear()
        self.foreign = False
        self._heard.clear()

    def keep_early(self, data: bytes) -> None:
        """These bytes came before the request can have left."""
        if len(self.early) < _SIZE:
            self.early += data

    def keep(self, data: bytes) -> None:
        """These bytes came since."""
        if len(self._heard) < _SIZE:
            self._heard += data

    def before(self, answer: Frame, mode: Mode, framer: ResponseFramer) -> Overheard:
        """What was heard before `answer`."""
        return overheard(mode, bytes(self.early + self._heard), self.sent, framer.encode(*answer))

    def instead(self, framer: ResponseFramer) -> bytes:
        """What was heard instead of an answer: everything but late answers to older requests."""
        heard = bytes(self.early + self._heard)
        for frame in self.late:
            heard = heard.replace(framer.encode(*frame), b"")
        return heard

    def has_begun(self, transaction: Transaction, mode: Mode, framer: ResponseFramer) -> bool:
        """Whether the answer has begun to come."""
        head = transaction.asked.response_head
        expected = head if transaction.answers_from is None else bytes((transaction.answers_from,)) + head
        return has_begun(mode, self.instead(framer).replace(self.sent, b""), expected)
